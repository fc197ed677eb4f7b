// A job as the page shows it, and how it follows from what the coordinator sends. Pure.

import type { WireEvent, WireJob, WirePlan, WirePoint, WireRequest, WireSession } from '../wire'
import { duration, metric, short } from './format'

export interface Estimate {
  value: number
  low: number
  high: number
}

/** A share of 1, by name. */
export interface Share {
  name: string
  value: number
}

/** What is known about the paths of one length or technique; null where it was not counted. */
export interface Group {
  name: string
  b: number | null
  probability: number | null
  proposed: number | null
  acceptance: number | null
}

export interface Job {
  id: string
  name: string
  user: string
  /** What it is a frame of. */
  sequence: { id: string; frame: number } | null
  request: WireRequest
  priority: number
  state: string
  paused: boolean
  ended: boolean
  failed: boolean
  stale: boolean
  created: number
  percent: number
  phase: string
  etaSeconds: number | null
  queuePosition: number | null
  note: string
  film: string | null
  rounds: number
  /** How often it went on after it had ended. */
  refinements: number
  target: number | null
  error: Estimate | null
  rate: number
  mutations: number
  integrator: string
  size: string
  acceptance: Share[]
  effectiveSamples: number | null
  effectivePerMutation: number | null
  lengths: Group[]
  techniques: Group[]
  anomalies: Share[]
  facts: [string, string][]
}

/** Whether the server lets them change a job of that user; it decides anyway. */
export function mayChange(session: WireSession | null, user: string): boolean {
  if (session === null || session.role === 'admin') return true
  return session.role === 'submit' && session.user === user
}

export interface Point {
  round: number
  mutations: number
  cpuSeconds: number
  wallSeconds: number
  error: Estimate
  b: Estimate
  acceptance: Share[]
  effectiveSamples: number | null
}

export interface Feature {
  name: string
  used: boolean
  evidence: string
}

export interface Choice {
  name: string
  value: string
  source: string
  why: string
}

export interface Plan {
  features: Feature[]
  choices: Choice[]
  /** What chose the integrator; null where it was asked for. */
  auto: string | null
}

export interface JobEvent {
  sequence: number
  kind: string
  at: number
  message: string
  attributes: Record<string, string>
  /** Who owned the job; the epoch grows with each owner, and is null where it was not told. */
  coordinator: string
  epoch: number | null
  state: string | null
  paused: boolean
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
    user: wire.user ?? '',
    sequence: wire.sequence ?? null,
    request: wire.request,
    priority: wire.request.priority ?? 0,
    state: wire.state,
    paused: wire.paused && !ended,
    ended,
    failed: wire.state === 'failed',
    stale: wire.stale ?? false,
    created: Date.parse(wire.created_at),
    percent: percentOf(wire),
    phase: phaseOf(wire, ended),
    etaSeconds: !ended && wire.eta_seconds ? wire.eta_seconds : null,
    queuePosition: wire.queue_position ?? null,
    note: [wire.error, wire.pause_reason, ...(wire.warnings ?? [])].filter(Boolean).join('\n'),
    film: wire.film_sha256 ?? null,
    rounds: wire.rounds_done,
    refinements: wire.refinements ?? 0,
    target: wire.request.stop?.target_error ?? null,
    error: wire.rel_mse === undefined ? null : errorOf(wire.rel_mse, wire),
    rate: ended ? 0 : wire.mutations_per_second,
    mutations: wire.mutations,
    integrator: wire.integrator ?? '',
    size: wire.width && wire.height ? `${wire.width} × ${wire.height}` : '',
    acceptance: acceptanceOf(wire.acceptance),
    effectiveSamples: wire.effective_samples ?? null,
    effectivePerMutation: wire.effective_samples_per_mutation ?? null,
    lengths: (wire.lengths ?? []).map((length) =>
      groupOf(length.edges === 1 ? '1 edge' : `${length.edges} edges`, length),
    ),
    techniques: (wire.techniques ?? []).map((technique) =>
      groupOf(`${technique.light_vertices} from light`, technique),
    ),
    anomalies: Object.entries(wire.anomalies ?? {})
      .filter(([, count]) => count > 0)
      .map(([name, value]) => ({ name, value })),
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
  const facts: [string, string | null][] = [
    ['Integrator', wire.integrator ?? null],
    ['Size', wire.width && wire.height ? `${wire.width} × ${wire.height}` : null],
    ['Seed', String(wire.seed)],
    ['Rounds', String(wire.rounds_done)],
    [
      'Relative error',
      wire.rel_mse === undefined ? null : withInterval(errorOf(wire.rel_mse, wire)),
    ],
    ['b', wire.b > 0 ? withInterval(bOf(wire)) : null],
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
    ['Longest stay', wire.longest_stay ? `${metric(wire.longest_stay)} mutations` : null],
    ['Trapped chains', wire.trapped_chains ? String(wire.trapped_chains) : null],
    ['Film', wire.film_sha256 ?? null],
  ]
  return facts.filter((fact): fact is [string, string] => fact[1] !== null)
}

const KINDS_OF_STEPS = [
  ['large', 'Large steps'],
  ['small', 'Small steps'],
  ['subpath', 'Subpath steps'],
  ['second', 'Second stage'],
  ['second_after_large', 'Second stage after large'],
] as const

function acceptanceOf(wire: WireJob['acceptance']): Share[] {
  return KINDS_OF_STEPS.flatMap(([key, name]) => {
    const value = wire[key]
    return value === undefined ? [] : [{ name, value }]
  })
}

function groupOf(
  name: string,
  wire: { b?: number; probability?: number; proposed?: number; acceptance?: number },
): Group {
  return {
    name,
    b: wire.b ?? null,
    probability: wire.probability ?? null,
    proposed: wire.proposed ?? null,
    acceptance: wire.acceptance ?? null,
  }
}

function errorOf(value: number, wire: Pick<WireJob, 'rel_mse_interval'>): Estimate {
  const { low = value, high = value } = wire.rel_mse_interval ?? {}
  return { value, low, high }
}

function bOf(wire: { b: number; b_standard_error: number }): Estimate {
  const half = Z95 * wire.b_standard_error
  return { value: wire.b, low: wire.b - half, high: wire.b + half }
}

export function toPoint(wire: WirePoint): Point {
  return {
    round: wire.round,
    mutations: wire.mutations,
    cpuSeconds: wire.cpu_seconds,
    wallSeconds: wire.wall_seconds,
    error: errorOf(wire.rel_mse, wire),
    b: bOf(wire),
    acceptance: acceptanceOf(wire.acceptance),
    effectiveSamples: wire.effective_samples ?? null,
  }
}

export function toPlan(wire: WirePlan): Plan {
  return {
    features: wire.features.map(({ name, state, evidence }) => ({
      name,
      used: state === 'used',
      evidence,
    })),
    choices: wire.choices ?? [],
    auto: wire.auto ? `auto chose ${wire.auto.integrator}: ${wire.auto.reason}` : null,
  }
}

export function toEvent(wire: WireEvent): JobEvent {
  const attributes: Record<string, string> = {}
  for (const [name, value] of Object.entries(wire.attributes ?? {})) {
    attributes[name] = typeof value === 'string' ? value : JSON.stringify(value)
  }
  return {
    sequence: wire.sequence,
    kind: wire.kind,
    at: Date.parse(wire.at),
    message: wire.message ?? '',
    attributes,
    coordinator: wire.coordinator ?? '',
    epoch: wire.epoch ?? null,
    state: wire.job?.state ?? null,
    paused: wire.job?.paused ?? false,
    job: wire.job ? toJob(wire.job) : null,
    point: wire.convergence ? toPoint(wire.convergence) : null,
  }
}

/** A job as an event tells of it: events leave the values of the scene's defaults out. */
export function toldOf(known: Job, told: Job): Job {
  const { defaults } = known.request
  return defaults === undefined ? told : { ...told, request: { ...told.request, defaults } }
}

/** What a job's badge says. */
export const shownState = (job: Job): string => (job.paused ? 'paused' : job.state)

export function withInterval(e: Estimate): string {
  return `${short(e.value)} (${short(e.low)} to ${short(e.high)})`
}

/** Whether a snapshot tells of a job as it was before another one: past events come first. */
export const isBefore = (job: Job, other: Job) =>
  job.refinements < other.refinements ||
  (job.refinements === other.refinements && job.rounds < other.rounds)

/** A word of a shell's command, which takes it as it is. */
const quoted = (text: string) => `'${text.replaceAll("'", "'\\''")}'`

/**
 * The commands that repeat a job up to a round, and with it what went wrong there. Where the server asks
 * for tokens they take it from METROFARM_TOKEN, as metrofarm does by itself: none is written down.
 */
export function replayCommand(job: Job, origin: string, tokens: boolean): string {
  const shows = tokens ? '-H "Authorization: Bearer $METROFARM_TOKEN" ' : ''
  const plan = quoted(`${origin}/v1/jobs/${encodeURIComponent(job.id)}/plan`)
  const file = quoted(`${job.id}.json`)
  return (
    `curl -sSf ${shows}${plan} | jq -c .resolved > ${file}\n` +
    `metrofarm submit SCENE --resolved ${file} --rounds ${Math.max(1, job.rounds)} --server ${quoted(origin)}`
  )
}
