// All jobs and workers. Of the jobs only the rows in sight are in the document.

import { useEffect, useRef, useState } from 'preact/hooks'

import { imagePath } from '../gateway'
import type { JobColumn, JobQuery, Totals, Worker } from '../model/farm'
import { selectJobs, sortedWorkers, totalsOf } from '../model/farm'
import { ago, duration, metric, short } from '../model/format'
import type { Job } from '../model/job'
import { withInterval } from '../model/job'
import { formatRoute } from '../model/route'
import type { Actions, State } from '../state'
import { useNow } from '../store'
import { Badge, Bar, Card, JobBadge, Select } from './parts'

const ROW = 52
const MARGIN = 6

const COLUMNS: [JobColumn, string][] = [
  ['name', 'Job'],
  ['state', 'State'],
  ['progress', 'Progress'],
  ['error', 'relMSE'],
  ['eta', 'Time left'],
  ['rate', 'Mutations/s'],
  ['queue', 'Queue'],
  ['age', 'Submitted'],
]

const STATES = [
  ['all', 'All'],
  ['live', 'Not ended'],
  ['rendering', 'Rendering'],
  ['queued', 'Queued'],
  ['paused', 'Paused'],
  ['ended', 'Ended'],
  ['done', 'Done'],
  ['failed', 'Failed'],
  ['canceled', 'Canceled'],
] as const

export function FarmPage({ state, actions }: { state: State; actions: Actions }) {
  const now = useNow(5)
  const jobs = selectJobs(state.farm, state.query)
  return (
    <div class="farm">
      <h1 class="unseen">Farm</h1>
      <TotalsStrip totals={totalsOf(state.farm)} />
      <div class="farm-columns">
        <Card
          title={`Jobs (${jobs.length}${jobs.length < state.farm.jobs.size ? ` of ${state.farm.jobs.size}` : ''})`}
          tools={<JobTools state={state} actions={actions} />}
          class="jobs"
        >
          <JobTable jobs={jobs} state={state} actions={actions} now={now} />
        </Card>
        <Card title={`Workers (${state.farm.workers.size})`} class="workers">
          <WorkerTable
            workers={sortedWorkers(state.farm)}
            now={now}
            mayDrain={state.session?.role === 'admin'}
            drain={actions.drain}
          />
        </Card>
      </div>
    </div>
  )
}

function TotalsStrip({ totals }: { totals: Totals }) {
  const { busy, idle, draining, lost } = totals.workers
  const parts: [string, string, string][] = [
    ['Jobs under way', String(totals.live), `${totals.paused} paused, ${totals.ended} ended`],
    ['Waiting for workers', String(totals.queued), 'with work for more'],
    ['Mutations per second', metric(totals.rate), 'of all jobs'],
    [
      'Workers',
      String(busy + idle + draining),
      `${busy} busy, ${idle} idle${lost > 0 ? `, ${lost} lost` : ''}`,
    ],
    ['Threads', String(totals.threads), 'of these workers'],
  ]
  return (
    <dl class="totals">
      {parts.map(([name, value, more]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>
            <strong>{value}</strong> <small>{more}</small>
          </dd>
        </div>
      ))}
    </dl>
  )
}

function JobTools({ state, actions }: { state: State; actions: Actions }) {
  const { query, picked } = state
  return (
    <>
      <input
        type="search"
        placeholder="Find by name, id, user"
        aria-label="Find jobs"
        value={query.text}
        onInput={(event) => {
          actions.setQuery({ text: event.currentTarget.value })
        }}
      />
      <Select
        label="Show"
        value={query.state}
        options={STATES}
        onChange={(chosen) => {
          actions.setQuery({ state: chosen })
        }}
      />
      <a
        class={`button ${picked.size > 1 ? 'primary' : ''}`}
        href={formatRoute({ page: 'compare', ids: [...picked] })}
        title="Tick jobs, then see their curves in one chart"
      >
        Compare{picked.size > 0 ? ` ${picked.size}` : ''}
      </a>
    </>
  )
}

interface JobTableProps {
  jobs: Job[]
  state: State
  actions: Actions
  now: number
}

/** The rows that are in sight of a scrolled element. */
function useWindow(count: number) {
  const element = useRef<HTMLDivElement>(null)
  const [view, setView] = useState({ top: 0, height: 800 })
  useEffect(() => {
    const scrolled = element.current
    if (scrolled === null) return
    const look = () => {
      setView({ top: scrolled.scrollTop, height: scrolled.clientHeight })
    }
    look()
    scrolled.addEventListener('scroll', look, { passive: true })
    const resized = new ResizeObserver(look)
    resized.observe(scrolled)
    return () => {
      scrolled.removeEventListener('scroll', look)
      resized.disconnect()
    }
  }, [])
  const first = Math.max(0, Math.floor(view.top / ROW) - MARGIN)
  const last = Math.min(count, Math.ceil((view.top + view.height) / ROW) + MARGIN)
  return { element, first, last }
}

function JobTable({ jobs, state, actions, now }: JobTableProps) {
  if (state.farm.jobs.size === 0) {
    return (
      <p class="empty">
        {state.listed ? 'No jobs yet. ' : 'Reading the list. '}
        <a href="#/submit">New job</a> or <code>metrofarm submit SCENE.xml</code> adds one.
      </p>
    )
  }
  return (
    <div class="job-table" role="table" aria-label="Jobs" aria-rowcount={jobs.length + 1}>
      <JobHead query={state.query} actions={actions} />
      <JobRows jobs={jobs} state={state} actions={actions} now={now} />
    </div>
  )
}

function JobRows({ jobs, state, actions, now }: JobTableProps) {
  const { element, first, last } = useWindow(jobs.length)
  return (
    <div class="rows" ref={element} role="rowgroup" tabIndex={0} aria-label="Rows of jobs">
      <div style={{ height: `${first * ROW}px` }} role="presentation" />
      {jobs.slice(first, last).map((job, i) => (
        <JobRow
          key={job.id}
          job={job}
          index={first + i + 2}
          picked={state.picked.has(job.id)}
          pick={actions.pick}
          now={now}
        />
      ))}
      <div style={{ height: `${(jobs.length - last) * ROW}px` }} role="presentation" />
    </div>
  )
}

function JobHead({ query, actions }: { query: JobQuery; actions: Actions }) {
  return (
    <div class="job-row head" role="row" aria-rowindex={1}>
      <span role="columnheader">
        <span class="unseen">Compare</span>
      </span>
      <span role="columnheader">
        <span class="unseen">Image</span>
      </span>
      {COLUMNS.map(([column, title]) => {
        const sorted = query.sort === column
        const order = query.descending ? 'descending' : 'ascending'
        return (
          <span key={column} role="columnheader" aria-sort={sorted ? order : 'none'} class={column}>
            <button
              type="button"
              class="plain"
              onClick={() => {
                actions.setQuery({ sort: column, descending: sorted ? !query.descending : false })
              }}
            >
              {title}
              <span aria-hidden="true">{sorted ? (query.descending ? ' ↓' : ' ↑') : ''}</span>
            </button>
          </span>
        )
      })}
    </div>
  )
}

interface JobRowProps {
  job: Job
  index: number
  picked: boolean
  pick: Actions['pick']
  now: number
}

function JobRow({ job, index, picked, pick, now }: JobRowProps) {
  return (
    <div class={`job-row ${job.stale ? 'old' : ''}`} role="row" aria-rowindex={index}>
      <span role="cell">
        <input
          type="checkbox"
          aria-label={`Compare ${job.name}`}
          checked={picked}
          onChange={(event) => {
            pick(job.id, event.currentTarget.checked)
          }}
        />
      </span>
      <span role="cell" class="thumbnail">
        {job.film !== null && job.rounds > 0 && (
          <img src={thumbnail(job)} alt="" width="56" height="42" loading="lazy" />
        )}
      </span>
      <span role="cell" class="name">
        <a href={formatRoute({ page: 'job', id: job.id })}>{job.name}</a>
        <small>
          {job.sequence !== null && (
            <>
              <a href={formatRoute({ page: 'sequence', id: job.sequence.id })}>sequence</a>
              {' · '}
            </>
          )}
          {[job.integrator, job.size, job.user].filter(Boolean).join(' · ') || job.id}
          {job.stale ? ' · as last stored' : ''}
        </small>
      </span>
      <span role="cell" class="state">
        <JobBadge job={job} />
      </span>
      <span role="cell" class="progress">
        <Bar value={job.percent} label={`${job.percent} %`} />
        <small title={job.phase}>
          {job.percent} % · {job.phase}
        </small>
      </span>
      <span role="cell" class="error number" title={job.error ? withInterval(job.error) : ''}>
        {job.error === null ? '–' : short(job.error.value)}
        {job.target !== null && <small>target {short(job.target)}</small>}
      </span>
      <span role="cell" class="eta number">
        {job.etaSeconds === null ? '–' : duration(job.etaSeconds)}
      </span>
      <span role="cell" class="rate number">
        {job.rate > 0 ? metric(job.rate) : '–'}
      </span>
      <span role="cell" class="queue number">
        {job.queuePosition ?? '–'}
        {job.priority !== 0 && !job.ended && <small>priority {job.priority}</small>}
      </span>
      <span role="cell" class="age number">
        {ago(job.created, now)}
      </span>
    </div>
  )
}

/** The film's name lets the browser keep the picture until there is a newer one. */
const thumbnail = (job: Job) => imagePath(job.id, 'png', `?size=112&film=${job.film ?? ''}`)

interface WorkerTableProps {
  workers: Worker[]
  now: number
  mayDrain: boolean
  drain: (id: string) => void
}

function WorkerTable({ workers, now, mayDrain, drain }: WorkerTableProps) {
  if (workers.length === 0) return <p class="empty">No worker is connected.</p>
  const most = Math.max(1, ...workers.map(({ rate }) => rate))
  return (
    <div class="worker-rows" tabIndex={0} role="region" aria-label="List of workers">
      <table>
        <thead>
          <tr>
            <th scope="col">Worker</th>
            <th scope="col">State</th>
            <th scope="col" class="number">
              Mutations/s
            </th>
            <th scope="col" class="number">
              Leases
            </th>
            <th scope="col" class="number">
              Contact
            </th>
            <th scope="col">
              <span class="unseen">Actions</span>
            </th>
          </tr>
        </thead>
        <tbody>
          {workers.map((worker) => (
            <tr key={worker.id}>
              <td class="name">
                <span title={worker.id}>{worker.name}</span>
                <small>
                  {worker.threads} {worker.threads === 1 ? 'thread' : 'threads'} ·{' '}
                  <span title={worker.version}>{worker.version.slice(0, 8)}</span>
                </small>
                {worker.note !== '' && <small class="bad">{worker.note}</small>}
              </td>
              <td>
                <Badge state={worker.state} />
              </td>
              <td class="number">
                {metric(worker.rate)}
                <Bar
                  value={(100 * worker.rate) / most}
                  label={`${metric(worker.rate)} per second`}
                />
              </td>
              <td class="number" title={worker.activity}>
                {worker.leases}
              </td>
              <td class="number">{ago(worker.lastContact, now)}</td>
              <td>
                <button
                  type="button"
                  disabled={!mayDrain || worker.state === 'draining' || worker.state === 'lost'}
                  title={
                    mayDrain ? 'Let it finish what it holds and leave' : 'Needs the role admin'
                  }
                  aria-label={`Drain ${worker.name}`}
                  onClick={() => {
                    drain(worker.id)
                  }}
                >
                  Drain
                </button>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  )
}
