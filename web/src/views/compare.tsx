// The curves of several jobs in one chart.

import { useState } from 'preact/hooks'

import type { Axis } from '../model/convergence'
import { costOf, joinCurves } from '../model/convergence'
import { metric, percent, short } from '../model/format'
import type { Job, Point } from '../model/job'
import { withInterval } from '../model/job'
import { formatRoute } from '../model/route'
import type { Actions, State } from '../state'
import { Chart, saveChart } from './charts'
import { Card, JobBadge, Select } from './parts'

export const AXIS_NAMES = [
  ['mutations', 'mutations'],
  ['wallSeconds', 'time'],
  ['cpuSeconds', 'CPU time'],
] as const satisfies readonly (readonly [Axis, string])[]

/** Colors of the style sheet that differ for everybody; dashes tell what comes after them. */
const COLORS = 6
const DASHES = [[], [6, 4], [2, 3]]

interface CompareProps {
  state: State
  actions: Actions
  ids: string[]
}

export function ComparePage({ state, actions, ids }: CompareProps) {
  const [axis, setAxis] = useState<Axis>('mutations')
  const jobs = ids.flatMap((id) => state.farm.jobs.get(id) ?? [])
  const curves = jobs.map((job) => state.curves.get(job.id) ?? [])
  const others = [...state.farm.jobs.values()]
    .filter((job) => !ids.includes(job.id) && job.rounds > 0)
    .sort((a, b) => b.created - a.created)
  const { x, columns } = joinCurves(curves, axis)
  const show = (shown: string[]) => {
    actions.go({ page: 'compare', ids: shown })
  }
  return (
    <div class="compare">
      <h1 class="unseen">Compare jobs</h1>
      <Card
        title="Relative error"
        tools={
          <>
            <Select label="Against" value={axis} options={AXIS_NAMES} onChange={setAxis} />
            <button
              type="button"
              onClick={(event) => {
                saveChart(event.currentTarget.closest('.card'), 'comparison.png')
              }}
            >
              PNG
            </button>
          </>
        }
      >
        {jobs.length === 0 ? (
          <p class="empty">Add jobs below, or tick them on the farm page.</p>
        ) : (
          <Chart
            height={420}
            label={`Relative error of ${jobs.map(({ name }) => name).join(', ')}`}
            data={{
              axis,
              x,
              logarithmic: true,
              curves: jobs.map((job, i) => ({
                label: labelOf(job, jobs),
                color: `--curve-${i % COLORS}`,
                dash: DASHES[Math.floor(i / COLORS) % DASHES.length] ?? [],
                points: true,
                values: columns[i] ?? [],
              })),
            }}
          />
        )}
      </Card>
      <Card
        title="Jobs"
        tools={
          <Select
            label="Add"
            value=""
            options={[
              ['', 'choose a job'],
              ...others.map((job) => [job.id, `${job.name} (${job.id})`] as const),
            ]}
            onChange={(id) => {
              if (id !== '') show([...ids, id])
            }}
          />
        }
      >
        <CompareTable jobs={jobs} curves={curves} axis={axis} ids={ids} show={show} />
      </Card>
    </div>
  )
}

const labelOf = (job: Job, jobs: Job[]) =>
  jobs.filter(({ name }) => name === job.name).length > 1
    ? `${job.name} ${job.id.slice(-5)}`
    : job.name

interface TableProps {
  jobs: Job[]
  curves: Point[][]
  axis: Axis
  ids: string[]
  show: (ids: string[]) => void
}

function CompareTable({ jobs, curves, axis, ids, show }: TableProps) {
  const costs = curves.map((points) => costOf(points, axis))
  const best = Math.min(...costs.flatMap((cost) => cost ?? []))
  return (
    <div class="scrolled" tabIndex={0} role="region" aria-label="Compared jobs">
      <table>
        <thead>
          <tr>
            <th scope="col">Job</th>
            <th scope="col">State</th>
            <th scope="col" class="number">
              relMSE
            </th>
            <th scope="col" class="number">
              Mutations
            </th>
            <th scope="col">Small, second accepted</th>
            <th scope="col" class="number" title="Error times cost, against the least of them">
              Cost of equal error
            </th>
            <th scope="col">Options</th>
            <th scope="col">
              <span class="unseen">Actions</span>
            </th>
          </tr>
        </thead>
        <tbody>
          {jobs.map((job, i) => (
            <tr key={job.id}>
              <td>
                <span class={`swatch curve-${i % COLORS}`} aria-hidden="true" />{' '}
                <a href={formatRoute({ page: 'job', id: job.id })}>{job.name}</a>{' '}
                <small class="id">{job.id}</small>
              </td>
              <td>
                <JobBadge job={job} />
              </td>
              <td class="number">{job.error === null ? '–' : withInterval(job.error)}</td>
              <td class="number">{metric(job.mutations)}</td>
              <td>
                {job.acceptance
                  .filter(({ name }) => /Small|Second stage$/.test(name))
                  .map(({ value }) => percent(value))
                  .join(', ') || '–'}
              </td>
              <td class="number">{costText(costs[i] ?? null, best)}</td>
              <td class="options">{optionsOf(job)}</td>
              <td>
                <button
                  type="button"
                  aria-label={`Remove ${job.name}`}
                  onClick={() => {
                    show(ids.filter((id) => id !== job.id))
                  }}
                >
                  Remove
                </button>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  )
}

const costText = (cost: number | null, best: number) =>
  cost === null ? '–' : `${short(cost / best)} ×`

const COMMON = new Set(['name', 'scene', 'entry', 'stop', 'resolved', 'priority'])

function optionsOf(job: Job): string {
  return Object.entries(job.request)
    .filter(([name]) => !COMMON.has(name))
    .map(([name, value]) => `${name} ${typeof value === 'string' ? value : JSON.stringify(value)}`)
    .join(', ')
}
