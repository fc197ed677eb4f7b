// When what happened to a job: phases, rounds, owners, workers and faults, from its events. Pure.

import type { JobEvent } from './job'

export interface Row {
  key: string
  label: string
}

export interface Span {
  row: string
  label: string
  from: number
  /** Null: it goes on. */
  to: number | null
}

export interface Mark {
  row: string
  label: string
  at: number
  bad: boolean
}

export interface Timeline {
  start: number
  end: number
  rows: Row[]
  spans: Span[]
  marks: Mark[]
}

export const PHASES = 'phase'
const ROUNDS = 'rounds'
export const OWNERS = 'owners'
const FAULTS = 'faults'

/** Rows for workers at most; more would not be read. */
const MAX_WORKERS = 12

export function timelineOf(events: readonly JobEvent[], now: number): Timeline | null {
  const first = events[0]
  const last = events.at(-1)
  if (first === undefined || last === undefined) return null
  const drawing = new Drawing(first.at)
  for (const event of events) drawing.add(event)
  const phase = drawing.spans.findLast(({ row }) => row === PHASES)
  const over = phase !== undefined && isEnd(phase.label)
  const end = Math.max(over ? Math.max(last.at, phase.from) : now, first.at + 1)
  return {
    start: first.at,
    end,
    rows: drawing.rows(),
    spans: drawing.spans.map((span) => ({ ...span, to: span.to ?? end })),
    marks: drawing.marks,
  }
}

const isEnd = (state: string) => ['done', 'failed', 'canceled'].includes(state)

class Drawing {
  readonly spans: Span[] = []
  readonly marks: Mark[] = []
  /** Rows by worker: one for all that have a name, if no two are there at once. */
  private readonly rowsOf = new Map<string, string>()
  private readonly labels = new Map<string, string>()
  private epoch: number | null = null
  private owners = 0

  /** The list of events is bounded: what is open at its start may have begun before. */
  constructor(private readonly start: number) {}

  add(event: JobEvent): void {
    this.noteOwner(event)
    const worker = event.attributes['worker']
    const bad = event.kind === 'fault' || event.kind === 'anomaly'
    if (event.kind === 'state' && event.state !== null) this.addPhase(event, event.state)
    if (event.kind === 'round') this.mark(ROUNDS, event.message || 'round', event.at)
    if (worker !== undefined) this.addWorker(event, worker)
    if (bad) this.mark(FAULTS, event.message, event.at, true)
    if (bad && worker !== undefined)
      this.mark(this.rowOf(event, worker), event.message, event.at, true)
  }

  rows(): Row[] {
    const workers = [...this.labels].slice(0, MAX_WORKERS)
    return [
      { key: PHASES, label: 'Phase' },
      { key: ROUNDS, label: 'Rounds' },
      ...(this.owners > 1 ? [{ key: OWNERS, label: 'Coordinator' }] : []),
      ...workers.map(([key, label]) => ({ key, label })),
      { key: FAULTS, label: 'Faults' },
    ]
  }

  private mark(row: string, label: string, at: number, bad = false): void {
    this.marks.push({ row, label, at, bad })
  }

  private open(row: string): Span | undefined {
    return this.spans.findLast((span) => span.row === row && span.to === null)
  }

  /** With another owner, workers join again. */
  private noteOwner({ epoch, coordinator, at }: JobEvent): void {
    if (epoch === null || epoch === this.epoch) return
    this.epoch = epoch
    this.owners++
    for (const span of this.spans) if (span.row !== PHASES) span.to ??= at
    this.spans.push({ row: OWNERS, label: coordinator, from: at, to: null })
  }

  private addPhase(event: JobEvent, state: string): void {
    const label = event.paused ? 'paused' : state
    const open = this.spans.findLast(({ row }) => row === PHASES)
    if (open?.label === label) return
    if (open !== undefined) open.to = event.at
    this.spans.push({ row: PHASES, label, from: event.at, to: isEnd(label) ? event.at : null })
    if (isEnd(label)) for (const span of this.spans) span.to ??= event.at
  }

  /** A worker that comes back, say with another coordinator, has another id but the same name. */
  private rowOf(event: JobEvent, id: string): string {
    const known = this.rowsOf.get(id)
    if (known !== undefined) return known
    const name = event.attributes['worker_name'] ?? id
    const former = [...this.labels].find(([row, label]) => label === name && !this.open(row))
    const row = former?.[0] ?? id
    this.rowsOf.set(id, row)
    this.labels.set(row, name)
    return row
  }

  /** Workers join a job and leave it; what is lost leaves. */
  private addWorker(event: JobEvent, id: string): void {
    const row = this.rowOf(event, id)
    const open = this.open(row)
    if (event.message.includes('joins')) {
      if (open === undefined) {
        this.spans.push({ row, label: 'at work', from: event.at, to: null })
      }
    } else if (/leaves|is lost|is excluded/.test(event.message)) {
      if (open !== undefined) open.to = event.at
      else if (!this.spans.some((span) => span.row === row)) {
        this.spans.push({ row, label: 'at work', from: this.start, to: event.at })
      }
    }
  }
}
