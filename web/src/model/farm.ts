// All jobs and workers: what the farm page shows. Pure.

import type { WireFarmChange, WireJob, WireWorker } from '../wire'
import type { Job } from './job'
import { shownState, toJob } from './job'

export interface Worker {
  id: string
  name: string
  version: string
  state: string
  threads: number
  lastContact: number
  leases: number
  activity: string
  rate: number
  note: string
}

export interface Farm {
  jobs: ReadonlyMap<string, Job>
  workers: ReadonlyMap<string, Worker>
  /** Jobs that were deleted, which a list that is being read may still have. */
  deleted: ReadonlySet<string>
}

export const emptyFarm: Farm = {
  jobs: new Map(),
  workers: new Map(),
  deleted: new Set(),
}

export function toWorker(wire: WireWorker): Worker {
  const conflicts = wire.conflicts > 0 ? `${wire.conflicts} conflicting batches` : ''
  return {
    id: wire.id,
    name: wire.name,
    version: wire.version,
    state: wire.state,
    threads: wire.threads,
    lastContact: Date.parse(wire.last_contact),
    leases: wire.leased_segments,
    activity: wire.activity ?? '',
    rate: wire.mutations_per_second,
    note: [wire.exclusion ?? '', conflicts].filter(Boolean).join('; '),
  }
}

/** Adds jobs of a list. What a stream has told of is newer than what a list says of it. */
export function addListed(farm: Farm, wires: readonly WireJob[]): Farm {
  const jobs = new Map(farm.jobs)
  for (const wire of wires) {
    if (!jobs.has(wire.id) && !farm.deleted.has(wire.id)) jobs.set(wire.id, toJob(wire))
  }
  return { ...farm, jobs }
}

/**
 * Drops ended jobs that a list, read from its beginning, does not have: they were deleted while nobody
 * told this page. Those that came since it began (before) stay; so do those older than its end, if there
 * are more.
 */
export function dropUnlisted(
  farm: Farm,
  before: Farm,
  listed: readonly WireJob[],
  complete: boolean,
): Farm {
  const ids = new Set(listed.map(({ id }) => id))
  const oldest = complete ? -Infinity : Math.min(...listed.map((w) => Date.parse(w.created_at)))
  const kept = [...farm.jobs].filter(
    ([id, job]) => ids.has(id) || !job.ended || !before.jobs.has(id) || job.created <= oldest,
  )
  return { ...farm, jobs: new Map(kept) }
}

/** Forgets a job that was deleted. */
export function dropJob(farm: Farm, id: string): Farm {
  const jobs = new Map(farm.jobs)
  jobs.delete(id)
  return { ...farm, jobs, deleted: new Set(farm.deleted).add(id) }
}

export function applyChange(farm: Farm, change: WireFarmChange): Farm {
  const jobs = new Map(farm.jobs)
  const workers = new Map(change.full ? [] : farm.workers)
  if (change.full) {
    // What has not ended and is not told of is gone; the list, read again, says what became of it.
    for (const job of farm.jobs.values()) if (!job.ended) jobs.delete(job.id)
  }
  for (const wire of change.jobs) jobs.set(wire.id, toJob(wire))
  for (const wire of change.workers) workers.set(wire.id, toWorker(wire))
  for (const id of change.gone) {
    jobs.delete(id)
    workers.delete(id)
  }
  return { jobs, workers, deleted: new Set([...farm.deleted, ...change.gone]) }
}

/** Takes a job as an answer told of it. */
export function putJob(farm: Farm, job: Job): Farm {
  return { ...farm, jobs: new Map(farm.jobs).set(job.id, job) }
}

export interface Totals {
  live: number
  paused: number
  queued: number
  ended: number
  rate: number
  threads: number
  workers: Record<'busy' | 'idle' | 'draining' | 'lost', number>
}

export function totalsOf(farm: Farm): Totals {
  const totals: Totals = {
    live: 0,
    paused: 0,
    queued: 0,
    ended: 0,
    rate: 0,
    threads: 0,
    workers: { busy: 0, idle: 0, draining: 0, lost: 0 },
  }
  for (const job of farm.jobs.values()) {
    if (job.ended) totals.ended++
    else totals.live++
    if (job.paused) totals.paused++
    if (job.queuePosition !== null) totals.queued++
    totals.rate += job.rate
  }
  for (const worker of farm.workers.values()) {
    if (isWorkerState(worker.state)) totals.workers[worker.state]++
    if (worker.state !== 'lost') totals.threads += worker.threads
  }
  return totals
}

const isWorkerState = (state: string): state is keyof Totals['workers'] =>
  ['busy', 'idle', 'draining', 'lost'].includes(state)

export const JOB_COLUMNS = [
  'name',
  'state',
  'progress',
  'error',
  'eta',
  'rate',
  'queue',
  'age',
] as const
export type JobColumn = (typeof JOB_COLUMNS)[number]

export interface JobQuery {
  text: string
  /** all, live, ended, or one state. */
  state: string
  sort: JobColumn
  descending: boolean
}

export const startQuery: JobQuery = { text: '', state: 'all', sort: 'age', descending: true }

/** Sort keys; null comes last either way. */
const KEYS: Record<JobColumn, (job: Job) => number | string | null> = {
  name: (job) => job.name.toLowerCase(),
  state: shownState,
  progress: (job) => job.percent,
  error: (job) => job.error?.value ?? null,
  eta: (job) => job.etaSeconds,
  rate: (job) => (job.ended ? null : job.rate),
  queue: (job) => job.queuePosition,
  age: (job) => job.created,
}

export function selectJobs(farm: Farm, query: JobQuery): Job[] {
  const words = query.text.toLowerCase().split(/\s+/).filter(Boolean)
  const chosen = [...farm.jobs.values()].filter((job) => {
    const text = `${job.name} ${job.id} ${job.user} ${job.integrator}`.toLowerCase()
    return matchesState(job, query.state) && words.every((word) => text.includes(word))
  })
  const key = KEYS[query.sort]
  const sign = query.descending ? -1 : 1
  return chosen.sort((a, b) => compare(key(a), key(b), sign) || b.created - a.created)
}

function matchesState(job: Job, state: string): boolean {
  if (state === 'all') return true
  if (state === 'live') return !job.ended
  return state === 'ended' ? job.ended : shownState(job) === state
}

function compare(a: number | string | null, b: number | string | null, sign: number): number {
  if (a === null || b === null) return Number(a === null) - Number(b === null)
  if (a === b) return 0
  return a < b ? -sign : sign
}

const WORKER_RANK: Partial<Record<string, number>> = { busy: 0, draining: 1, idle: 2, lost: 3 }

export function sortedWorkers(farm: Farm): Worker[] {
  const rank = (worker: Worker) => WORKER_RANK[worker.state] ?? 4
  return [...farm.workers.values()].sort(
    (a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name) || a.id.localeCompare(b.id),
  )
}
