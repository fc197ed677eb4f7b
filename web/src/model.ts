// What the page shows, and how it follows from what the coordinator sends. Pure.

import type { WireEvent, WireJob, WirePlan, WirePoint, WireWorker } from './wire'

export interface Estimate {
  value: number
  low: number
  high: number
}

export interface Job {
  id: string
  name: string
  state: string
  paused: boolean
  ended: boolean
  percent: number
  phase: string
  etaSeconds: number | null
  note: string
  failed: boolean
  film: string | null
  target: number | null
  facts: [string, string][]
}

export interface Point {
  round: number
  mutations: number
  error: Estimate
  b: Estimate
}

export interface Worker {
  id: string
  name: string
  state: string
  threads: number
  detail: string
}

export interface Feature {
  name: string
  used: boolean
  evidence: string
}

export interface Plan {
  features: Feature[]
  /** What chose the integrator; null where it was asked for. */
  auto: string | null
}

export interface JobEvent {
  kind: string
  job: Job | null
  point: Point | null
}

const ENDED = new Set(['done', 'failed', 'canceled'])

/** Half width of a 95 % interval, in standard errors. */
const Z95 = 1.96

export function toJob(wire: WireJob): Job {
  const ended = ENDED.has(wire.state)
  return {
    id: wire.id,
    name: wire.request.name ?? wire.request.entry,
    state: wire.state,
    paused: wire.paused && !ended,
    ended,
    percent: percentOf(wire),
    phase: phaseOf(wire, ended),
    etaSeconds: !ended && wire.eta_seconds ? wire.eta_seconds : null,
    note: [wire.error, ...(wire.warnings ?? [])].filter(Boolean).join('\n'),
    failed: wire.state === 'failed',
    film: wire.film_sha256 ?? null,
    target: wire.request.stop?.target_error ?? null,
    facts: factsOf(wire),
  }
}

/** Floored; 100 only for a job that is done. */
export function percentOf(wire: Pick<WireJob, 'state' | 'progress'>): number {
  if (wire.state === 'done') return 100
  return Math.max(0, Math.min(99, Math.floor(wire.progress * 100)))
}

function phaseOf(wire: WireJob, ended: boolean): string {
  if (wire.state === 'done') return stopText(wire.stop_reason ?? '')
  if (ended) return wire.state
  const parts = [wire.state === 'rendering' ? `round ${wire.rounds_done + 1}` : wire.state]
  if (wire.round_segments > 0) {
    parts.push(`${wire.round_segments_done} of ${wire.round_segments} segments`)
  }
  if (wire.activity && wire.activity !== wire.state) parts.push(wire.activity)
  return parts.join(', ')
}

const STOP_TEXTS: Partial<Record<string, string>> = {
  count: 'all samples taken',
  target_error: 'target error reached',
  time: 'time is up',
  rounds: 'all rounds done',
  finished: 'finished on request',
  black: 'no light reaches the camera',
}

function stopText(reason: string): string {
  return STOP_TEXTS[reason] ?? (reason || 'done')
}

function factsOf(wire: WireJob): [string, string][] {
  const anomalies = Object.entries(wire.anomalies ?? {}).filter(([, count]) => count > 0)
  const facts: [string, string | null][] = [
    ['Integrator', wire.integrator ?? null],
    ['Size', wire.width && wire.height ? `${wire.width} × ${wire.height}` : null],
    ['Seed', String(wire.seed)],
    ['Rounds', String(wire.rounds_done)],
    ['Relative error', wire.rel_mse === undefined ? null : withInterval(errorOf(wire))],
    ['b', wire.b > 0 ? withInterval(bOf(wire)) : null],
    ['Large steps accepted', ratio(wire.acceptance.large)],
    ['Small steps accepted', ratio(wire.acceptance.small)],
    ['Second stages accepted', ratio(wire.acceptance.second)],
    [
      'Coordinates per mutation',
      wire.coordinates_per_mutation ? short(wire.coordinates_per_mutation) : null,
    ],
    ['Mutations', metric(wire.mutations)],
    [
      'Mutations per second',
      wire.mutations_per_second > 0 ? metric(wire.mutations_per_second) : null,
    ],
    ['Rays', metric(wire.rays)],
    ['CPU time', duration(wire.cpu_seconds)],
    ['Wall time', duration(wire.wall_seconds)],
    ['Anomalies', anomalies.map(([kind, count]) => `${count} ${kind}`).join(', ') || 'none'],
    ['Film', wire.film_sha256 ?? null],
  ]
  return facts.filter((fact): fact is [string, string] => fact[1] !== null)
}

function errorOf(wire: WireJob): Estimate {
  const value = wire.rel_mse ?? 0
  return {
    value,
    low: wire.rel_mse_interval?.low ?? value,
    high: wire.rel_mse_interval?.high ?? value,
  }
}

function bOf(wire: { b: number; b_standard_error: number }): Estimate {
  const half = Z95 * wire.b_standard_error
  return { value: wire.b, low: wire.b - half, high: wire.b + half }
}

export function toPoint(wire: WirePoint): Point {
  return {
    round: wire.round,
    mutations: wire.mutations,
    error: {
      value: wire.rel_mse,
      low: wire.rel_mse_interval.low,
      high: wire.rel_mse_interval.high,
    },
    b: bOf(wire),
  }
}

export function toPlan(wire: WirePlan): Plan {
  return {
    features: wire.features.map(({ name, state, evidence }) => ({
      name,
      used: state === 'used',
      evidence,
    })),
    auto: wire.auto ? `auto chose ${wire.auto.integrator}: ${wire.auto.reason}` : null,
  }
}

export function toEvent(wire: WireEvent): JobEvent {
  return {
    kind: wire.kind,
    job: wire.job ? toJob(wire.job) : null,
    point: wire.convergence ? toPoint(wire.convergence) : null,
  }
}

export function toWorker(wire: WireWorker): Worker {
  const detail = [
    wire.mutations_per_second > 0 ? `${metric(wire.mutations_per_second)}/s` : '',
    wire.leased_segments > 0 ? `${wire.leased_segments} segments` : '',
    wire.activity ?? '',
  ]
  return {
    id: wire.id,
    name: wire.name,
    state: wire.state,
    threads: wire.threads,
    detail: detail.filter(Boolean).join(', '),
  }
}

/** Adds a point; a round that is already there (an event that came twice) replaces it. */
export function addPoint(points: readonly Point[], point: Point): Point[] {
  return [...points.filter((other) => other.round !== point.round), point].sort(
    (a, b) => a.round - b.round,
  )
}

/** Columns of the error chart, all positive or null: its axes are logarithmic. */
export interface ErrorColumns {
  mutations: number[]
  error: (number | null)[]
  low: (number | null)[]
  high: (number | null)[]
  guide: (number | null)[]
  target: (number | null)[]
}

export function errorColumns(points: readonly Point[], target: number | null): ErrorColumns {
  const usable = points.filter((point) => point.mutations > 0)
  // The guide falls as 1/N from the last point, so that its distance shows how the start deviated.
  const last = usable.findLast((point) => point.error.value > 0)
  return {
    mutations: usable.map((point) => point.mutations),
    error: usable.map((point) => positive(point.error.value)),
    low: usable.map((point) => positive(point.error.low)),
    high: usable.map((point) => positive(point.error.high)),
    guide: usable.map((point) =>
      last ? (last.error.value * last.mutations) / point.mutations : null,
    ),
    target: usable.map(() => (target === null ? null : positive(target))),
  }
}

function positive(x: number): number | null {
  return Number.isFinite(x) && x > 0 ? x : null
}

function withInterval(e: Estimate): string {
  return `${short(e.value)} (${short(e.low)} to ${short(e.high)})`
}

export function short(x: number): string {
  return String(Number(x.toPrecision(3)))
}

function ratio(x: number | undefined): string | null {
  return x === undefined ? null : `${Math.floor(x * 1000) / 10} %`
}

export function metric(x: number): string {
  for (const prefix of ['', ' k', ' M', ' G']) {
    if (x < 999.5) return short(x) + prefix
    x /= 1000
  }
  return `${short(x)} T`
}

export function duration(seconds: number): string {
  const whole = Math.ceil(seconds)
  const pad = (n: number) => String(n).padStart(2, '0')
  if (whole >= 3600) return `${Math.floor(whole / 3600)} h ${pad(Math.floor(whole / 60) % 60)} min`
  if (whole >= 60) return `${Math.floor(whole / 60)} min ${pad(whole % 60)} s`
  return `${whole} s`
}
