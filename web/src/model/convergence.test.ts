import { describe, expect, it } from 'vitest'

import { wirePoint } from '../testing/wires'
import {
  addPoint,
  bColumns,
  costOf,
  errorColumns,
  joinCurves,
  timeToTarget,
  toCSV,
} from './convergence'
import type { Point } from './job'
import { toPoint } from './job'

const at = (n: number, error: number) => toPoint(wirePoint(n, n, error))

it('points stay in order of rounds, each once', () => {
  const points = [3, 1, 2, 2].reduce<Point[]>((all, n) => addPoint(all, at(n, 1 / n)), [])
  expect(points.map((point) => point.round)).toEqual([1, 2, 3])
})

describe('errorColumns', () => {
  it('anchors the 1/N guide at the last point', () => {
    const columns = errorColumns(
      [1, 2, 4].map((n) => at(n, 8 / n ** 2)),
      'mutations',
      0.25,
    )
    expect(columns.guide).toEqual([2, 1, 0.5])
    expect(columns.error).toEqual([8, 2, 0.5])
    expect(columns.target).toEqual([0.25, 0.25, 0.25])
  })

  it('keeps what a logarithmic axis cannot show away from it', () => {
    const columns = errorColumns([at(0, 1), at(10, 0)], 'mutations', null)
    expect(columns.x).toEqual([10])
    expect(columns.error).toEqual([null])
    expect(columns.guide).toEqual([null])
    expect(columns.target).toEqual([null])
  })

  it('has rising times only', () => {
    const stopped = { ...at(3, 1), wallSeconds: 2 }
    expect(errorColumns([at(1, 1), at(2, 1), stopped], 'wallSeconds', null).x).toEqual([1, 2])
    expect(errorColumns([at(1, 1)], 'cpuSeconds', null).x).toEqual([2])
  })
})

it('bColumns leaves out rounds without b', () => {
  const dark = { ...at(1, 1), b: { value: 0, low: 0, high: 0 } }
  expect(bColumns([dark, at(2, 1)], 'mutations').x).toEqual([2])
})

it('joinCurves has a value where a job has a point', () => {
  const joined = joinCurves([[at(1, 4), at(3, 2)], [at(2, 8)], []], 'mutations')
  expect(joined.x).toEqual([1, 2, 3])
  expect(joined.columns).toEqual([
    [4, null, 2],
    [null, 8, null],
    [null, null, null],
  ])
})

describe('timeToTarget', () => {
  it('extends the pace so far with 1/N', () => {
    const points = [at(5, 1), at(10, 0.5)] // 10 s for an error of 0.5
    expect(timeToTarget(points, 0.1)).toEqual({ value: 40, low: 15, high: 90 })
  })

  it('is zero below the target, and unknown before the second round', () => {
    expect(timeToTarget([at(1, 1), at(2, 0.1)], 0.5)?.value).toBe(0)
    expect(timeToTarget([at(1, 1)], 0.5)).toBeNull()
    expect(timeToTarget([at(1, 1), at(2, 0)], 0.5)).toBeNull()
  })
})

it('costOf is error times work, of the last point that has both', () => {
  expect(costOf([at(1, 4), at(10, 0.5), at(20, 0)], 'mutations')).toBe(5)
  expect(costOf([], 'mutations')).toBeNull()
})

it('toCSV has a row for each round', () => {
  const [head, row, end] = toCSV([at(2, 1)]).split('\n')
  expect(head?.split(',').length).toBe(row?.split(',').length)
  expect(row).toMatch(/^2,2,4,2,1,0.5,2,2,/)
  expect(end).toBe('')
})
