// What is known about a job beside its image and its error.

import { useMemo, useState } from 'preact/hooks'

import { duration, metric, percent, short } from '../model/format'
import type { Group, Job, JobEvent, Plan, Point } from '../model/job'
import { replayCommand } from '../model/job'
import type { Timeline } from '../model/timeline'
import { OWNERS, PHASES, timelineOf } from '../model/timeline'
import { useNow } from '../store'
import { Chart } from './charts'
import { Bar, Card } from './parts'

export function Facts({ job }: { job: Job }) {
  return (
    <Card title="Figures">
      <dl class="facts">
        {job.facts.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
    </Card>
  )
}

/** How the chains fare: what is accepted, and how many samples they are worth. */
export function Chains({ job, points }: { job: Job; points: Point[] }) {
  const data = useMemo(() => {
    const known = points.filter((point) => point.effectiveSamples && point.mutations > 0)
    return {
      axis: 'mutations' as const,
      x: known.map(({ mutations }) => mutations),
      curves: [
        {
          label: 'effective samples',
          color: '--curve-1',
          values: known.map(({ effectiveSamples }) => effectiveSamples),
          points: true,
        },
      ],
      logarithmic: true,
    }
  }, [points])
  if (job.acceptance.length === 0) return null
  return (
    <Card title="Chains">
      <table class="shares">
        <caption class="unseen">Share of proposals accepted</caption>
        <tbody>
          {job.acceptance.map(({ name, value }) => (
            <tr key={name}>
              <th scope="row">{name} accepted</th>
              <td class="number">{percent(value)}</td>
              <td>
                <Bar value={100 * value} label={percent(value)} />
              </td>
            </tr>
          ))}
          {job.effectiveSamples !== null && (
            <tr>
              <th scope="row">Effective samples</th>
              <td class="number">{metric(job.effectiveSamples)}</td>
              <td class="muted">
                {job.effectivePerMutation === null
                  ? ''
                  : `one in ${metric(1 / job.effectivePerMutation)} mutations`}
              </td>
            </tr>
          )}
        </tbody>
      </table>
      {data.x.length > 1 && <Chart data={data} height={130} label="Effective samples by round" />}
    </Card>
  )
}

export function Groups({ title, groups }: { title: string; groups: Group[] }) {
  if (groups.length === 0) return null
  const total = groups.reduce((sum, { b }) => sum + (b ?? 0), 0)
  const share = (value: number | null) => (value === null ? '–' : percent(value))
  return (
    <Card title={title}>
      <div class="scrolled" tabIndex={0} role="region" aria-label={title}>
        <table class="shares">
          <thead>
            <tr>
              <th scope="col">Paths</th>
              {total > 0 && <th scope="col">Share of b</th>}
              <th scope="col">Proposed</th>
              <th scope="col" class="number">
                Accepted
              </th>
            </tr>
          </thead>
          <tbody>
            {groups.map(({ name, b, proposed, acceptance }) => (
              <tr key={name}>
                <th scope="row">{name}</th>
                {total > 0 && (
                  <td>
                    <Bar value={(100 * (b ?? 0)) / total} label={share((b ?? 0) / total)} />{' '}
                    {share((b ?? 0) / total)}
                  </td>
                )}
                <td>
                  <Bar value={100 * (proposed ?? 0)} label={share(proposed)} /> {share(proposed)}
                </td>
                <td class="number">{share(acceptance)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Card>
  )
}

/** Lists of a hundred numbers are for the pointer. */
const clipped = (text: string) => (text.length > 120 ? `${text.slice(0, 120)}…` : text)

export function PlanCard({ plan }: { plan: Plan }) {
  const used = plan.features.filter((feature) => feature.used)
  const skipped = plan.features.filter((feature) => !feature.used)
  return (
    <Card title={`Plan: ${used.length} features used, ${skipped.length} skipped`} class="plan">
      {plan.auto !== null && <p>{plan.auto}</p>}
      <div class="scrolled" tabIndex={0} role="region" aria-label="Plan">
        <table>
          <thead>
            <tr>
              <th scope="col">Feature</th>
              <th scope="col">State</th>
              <th scope="col">Why</th>
            </tr>
          </thead>
          <tbody>
            {[...used, ...skipped].map((feature) => (
              <tr key={feature.name} class={feature.used ? '' : 'skipped'}>
                <th scope="row">{feature.name}</th>
                <td>{feature.used ? '✓ used' : '– skipped'}</td>
                <td>{feature.evidence}</td>
              </tr>
            ))}
            {plan.choices.map((choice) => (
              <tr key={`choice ${choice.name}`}>
                <th scope="row">{choice.name.replaceAll('_', ' ')}</th>
                <td title={choice.value}>{clipped(choice.value)}</td>
                <td>
                  {choice.why} <small>({choice.source})</small>
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Card>
  )
}

interface AnomaliesProps {
  job: Job
  events: JobEvent[]
  /** Whether the server asks for tokens. */
  tokens: boolean
}

export function Anomalies({ job, events, tokens }: AnomaliesProps) {
  const total = job.anomalies.reduce((sum, { value }) => sum + value, 0)
  if (total === 0) {
    return (
      <Card title="Anomalies">
        <p class="empty">None: no contribution was infinite, negative or not a number.</p>
      </Card>
    )
  }
  const shown = events.filter(({ kind }) => kind === 'anomaly').slice(-20)
  return (
    <Card title={`Anomalies: ${metric(total)} of ${metric(job.mutations)} mutations`}>
      <p>
        Set to zero: {job.anomalies.map(({ name, value }) => `${value} ${name}`).join(', ')}. These
        commands repeat the job’s rounds, bit by bit, and what went wrong in them:
      </p>
      <pre tabIndex={0}>{replayCommand(job, location.origin, tokens)}</pre>
      <ul class="log" tabIndex={0} aria-label="Samples of anomalies">
        {shown.map((event) => (
          <li key={event.sequence}>{event.message}</li>
        ))}
      </ul>
    </Card>
  )
}

export function TimelineCard({ job, events }: { job: Job; events: JobEvent[] }) {
  const now = useNow(job.ended ? 3600 : 5)
  const timeline = useMemo(() => timelineOf(events, now), [events, now])
  if (timeline === null) return null
  return (
    <Card title={`Timeline over ${duration((timeline.end - timeline.start) / 1000)}`} class="wide">
      <TimelineChart timeline={timeline} />
    </Card>
  )
}

const WIDTH = 1000
const ROW = 20
const GUTTER = 110

function TimelineChart({ timeline: { start, end, rows, spans, marks } }: { timeline: Timeline }) {
  const x = (time: number) => GUTTER + ((time - start) / (end - start)) * (WIDTH - GUTTER - 8)
  const y = (key: string) => ROW * rows.findIndex((row) => row.key === key)
  const when = (time: number) => duration((time - start) / 1000)
  return (
    <svg
      class="timeline"
      viewBox={`0 0 ${WIDTH} ${ROW * rows.length}`}
      role="img"
      aria-label={`Timeline: ${rows.map(({ label }) => label).join(', ')}`}
    >
      {rows.map(({ key, label }) => (
        <g key={key}>
          <text x="0" y={y(key) + 14}>
            {label.slice(0, 16)}
          </text>
          <line x1={GUTTER} x2={WIDTH} y1={y(key) + ROW - 1} y2={y(key) + ROW - 1} />
        </g>
      ))}
      {spans
        .filter(({ row }) => y(row) >= 0)
        .map(({ row, label, from, to }) => {
          const width = Math.max(2, x(to ?? end) - x(from))
          return (
            <g key={`${row} ${from}`} class={`span ${label}`}>
              <rect x={x(from)} y={y(row) + 3} width={width} height={ROW - 6} rx="2" />
              <title>{`${label} from ${when(from)} to ${when(to ?? end)}`}</title>
              {width > 7 * label.length && (row === PHASES || row === OWNERS) && (
                <text x={x(from) + 4} y={y(row) + 14}>
                  {label}
                </text>
              )}
            </g>
          )
        })}
      {marks
        .filter(({ row }) => y(row) >= 0)
        .map(({ row, label, at, bad }) => (
          <path
            key={`${row} ${at} ${label}`}
            class={bad ? 'mark bad' : 'mark'}
            d={bad ? `M${x(at)} ${y(row) + 4}l5 11h-10z` : `M${x(at)} ${y(row) + 4}v12`}
          >
            <title>{`${when(at)}: ${label}`}</title>
          </path>
        ))}
    </svg>
  )
}

/** Lines of the log that are shown until all are asked for. */
const TAIL = 12

export function Log({ events }: { events: JobEvent[] }) {
  const [all, setAll] = useState(false)
  const lines = events.filter(({ message }) => message !== '')
  const shown = all ? lines : lines.slice(-TAIL)
  return (
    <Card
      title="Log"
      class="wide"
      tools={
        lines.length > TAIL && (
          <button
            type="button"
            onClick={() => {
              setAll(!all)
            }}
          >
            {all ? 'The last lines' : `All ${lines.length} lines`}
          </button>
        )
      }
    >
      <ol class="log" tabIndex={0} aria-label="Lines of the log">
        {shown.map((event) => (
          <li key={event.sequence} class={event.kind}>
            <time>{new Date(event.at).toLocaleTimeString()}</time> <b>{event.kind}</b>{' '}
            {event.message} <small>{attributesOf(event)}</small>
          </li>
        ))}
      </ol>
    </Card>
  )
}

function attributesOf({ point, attributes }: JobEvent): string {
  const known = Object.entries(attributes).map(([name, value]) => `${name} ${value}`)
  if (point !== null) {
    known.push(`relMSE ${short(point.error.value)}`, `${metric(point.mutations)} mutations`)
  }
  return known.join(', ')
}
