// Curves of error and of b, and what follows from them. Pure.

import type { Estimate, Point } from './job'

export type Axis = 'mutations' | 'wallSeconds' | 'cpuSeconds'

/** Adds a point; a round that is already there (an event that came twice) replaces it. */
export function addPoint(points: readonly Point[], point: Point): Point[] {
  return [...points.filter((other) => other.round !== point.round), point].sort(
    (a, b) => a.round - b.round,
  )
}

type Column = (number | null)[]

/** Columns of the error chart, all positive or null: its axes are logarithmic. */
export interface ErrorColumns {
  x: number[]
  error: Column
  low: Column
  high: Column
  guide: Column
  target: Column
}

/** The points that have a place on an axis, from left to right and no two at the same. */
function placed(points: readonly Point[], axis: Axis): Point[] {
  const usable: Point[] = []
  for (const point of points) {
    const last = usable.at(-1)
    if (point[axis] > (last === undefined ? 0 : last[axis])) usable.push(point)
  }
  return usable
}

export function errorColumns(
  points: readonly Point[],
  axis: Axis,
  target: number | null,
): ErrorColumns {
  const usable = placed(points, axis)
  // The guide falls as 1/N from the last point, so that its distance shows how the start deviated.
  const last = usable.findLast((point) => point.error.value > 0)
  return {
    x: usable.map((point) => point[axis]),
    error: usable.map((point) => positive(point.error.value)),
    low: usable.map((point) => positive(point.error.low)),
    high: usable.map((point) => positive(point.error.high)),
    guide: usable.map((point) => (last ? (last.error.value * last[axis]) / point[axis] : null)),
    target: usable.map(() => (target === null ? null : positive(target))),
  }
}

export interface BColumns {
  x: number[]
  b: Column
  low: Column
  high: Column
}

export function bColumns(points: readonly Point[], axis: Axis): BColumns {
  const usable = placed(points, axis).filter((point) => point.b.value > 0)
  return {
    x: usable.map((point) => point[axis]),
    b: usable.map((point) => point.b.value),
    low: usable.map((point) => point.b.low),
    high: usable.map((point) => point.b.high),
  }
}

/** The curves of several jobs over one axis: each has a value where it has a point. */
export function joinCurves(
  curves: readonly (readonly Point[])[],
  axis: Axis,
): { x: number[]; columns: Column[] } {
  const all = curves.map((points) => placed(points, axis))
  const x = [...new Set(all.flatMap((points) => points.map((point) => point[axis])))].sort(
    (a, b) => a - b,
  )
  const columns = all.map((points) => {
    const at = new Map(points.map((point) => [point[axis], positive(point.error.value)]))
    return x.map((value) => at.get(value) ?? null)
  })
  return { x, columns }
}

function positive(x: number): number | null {
  return Number.isFinite(x) && x > 0 ? x : null
}

/** Rounds that a time can be told from; those before them are too rough. */
export const PILOT_ROUNDS = 2

/**
 * Seconds of rendering until the error falls to the target if it goes on as 1/N, at the pace of the
 * rounds so far; the interval is that of the error. Null before there is an estimate.
 */
export function timeToTarget(points: readonly Point[], target: number): Estimate | null {
  const last = points.at(-1)
  if (last === undefined || points.length < PILOT_ROUNDS) return null
  if (!(last.error.value > 0) || !(target > 0) || !(last.wallSeconds > 0)) return null
  const until = (error: number) => Math.max(0, last.wallSeconds * (error / target - 1))
  return {
    value: until(last.error.value),
    low: until(last.error.low),
    high: until(last.error.high),
  }
}

/** How much longer one job needs than another for the same error: the product of error and time. */
export function costOf(points: readonly Point[], axis: Axis): number | null {
  const last = points.findLast((point) => point.error.value > 0 && point[axis] > 0)
  return last === undefined ? null : last.error.value * last[axis]
}

export function toCSV(points: readonly Point[]): string {
  const head =
    'round,mutations,cpu_seconds,wall_seconds,rel_mse,rel_mse_low,rel_mse_high,b,b_low,b_high'
  const rows = points.map((p) =>
    [p.round, p.mutations, p.cpuSeconds, p.wallSeconds]
      .concat([p.error.value, p.error.low, p.error.high, p.b.value, p.b.low, p.b.high])
      .join(','),
  )
  return [head, ...rows].join('\n') + '\n'
}
