import { describe, expect, it } from 'vitest'

import {
  addPoint,
  duration,
  errorColumns,
  metric,
  percentOf,
  toEvent,
  toJob,
  toPlan,
  toPoint,
  toWorker,
} from './model'
import type { Point } from './model'
import type { WireJob, WirePoint } from './wire'

function wireJob(change: Partial<WireJob> = {}): WireJob {
  return {
    id: 'j1',
    request: { entry: 'scene.xml' },
    state: 'rendering',
    paused: false,
    created_at: '2026-01-01T00:00:00Z',
    seed: 0,
    rounds_done: 2,
    round_segments: 16,
    round_segments_done: 4,
    progress: 0.5,
    mutations_per_second: 0,
    mutations: 0,
    rays: 0,
    cpu_seconds: 0,
    wall_seconds: 0,
    b: 0,
    b_standard_error: 0,
    acceptance: {},
    anomalies: null,
    ...change,
  }
}

function wirePoint(round: number, mutations: number, error: number): WirePoint {
  return {
    round,
    mutations,
    rel_mse: error,
    rel_mse_interval: { low: error / 2, high: error * 2, level: 0.95 },
    b: 2,
    b_standard_error: 0.5,
  }
}

describe('percentOf', () => {
  it.each([
    ['rendering', 0.999999, 99],
    ['rendering', 1, 99],
    ['rendering', 0.4299, 42],
    ['failed', 1, 99],
    ['queued', -0.1, 0],
    ['done', 0.3, 100],
  ])('of a %s job at %f is %i', (state, progress, want) => {
    expect(percentOf({ state, progress })).toBe(want)
  })
})

describe('toJob', () => {
  it('prefers the name to the entry and tells the phase', () => {
    expect(toJob(wireJob()).name).toBe('scene.xml')
    const job = toJob(wireJob({ request: { entry: 's.xml', name: 'Ajar' }, activity: 'merging' }))
    expect(job.name).toBe('Ajar')
    expect(job.phase).toBe('round 3, 4 of 16 segments, merging')
  })

  it('has no time left and no pause once it has ended', () => {
    const job = toJob(wireJob({ state: 'canceled', paused: true, eta_seconds: 9 }))
    expect([job.ended, job.paused, job.etaSeconds]).toEqual([true, false, null])
  })

  it('leaves out facts that are not known, and shows intervals of those that are', () => {
    const names = (change: Partial<WireJob>) => toJob(wireJob(change)).facts.map(([name]) => name)
    expect(names({})).not.toContain('Relative error')
    const facts = new Map(
      toJob(
        wireJob({
          rel_mse: 0.00123,
          rel_mse_interval: { low: 0.001, high: 0.002, level: 0.95 },
          acceptance: { large: 0.4567 },
          anomalies: { nan: 2, infinite: 0 },
        }),
      ).facts,
    )
    expect(facts.get('Relative error')).toBe('0.00123 (0.001 to 0.002)')
    expect(facts.get('Large steps accepted')).toBe('45.6 %')
    expect(facts.has('Small steps accepted')).toBe(false)
    expect(facts.get('Anomalies')).toBe('2 nan')
  })

  it('says why it is done', () => {
    expect(toJob(wireJob({ state: 'done', stop_reason: 'count' })).phase).toBe('all samples taken')
    expect(toJob(wireJob({ state: 'done', stop_reason: 'new rule' })).phase).toBe('new rule')
    expect(toJob(wireJob({ state: 'done' })).phase).toBe('done')
  })

  it('puts error and warnings into the note', () => {
    expect(toJob(wireJob({ error: 'bad', warnings: ['w1', 'w2'] })).note).toBe('bad\nw1\nw2')
  })
})

describe('points', () => {
  it('stay in order of rounds, each once', () => {
    const points = [3, 1, 2, 2].reduce<Point[]>(
      (all, round) => addPoint(all, toPoint(wirePoint(round, 100 * round, 1 / round))),
      [],
    )
    expect(points.map((point) => point.round)).toEqual([1, 2, 3])
  })

  it('carry a 95 % interval of b', () => {
    const { b } = toPoint(wirePoint(1, 100, 1))
    expect([b.low, b.high]).toEqual([2 - 0.98, 2 + 0.98])
  })
})

describe('errorColumns', () => {
  it('anchors the 1/N guide at the last point', () => {
    const columns = errorColumns(
      [1, 2, 4].map((n) => toPoint(wirePoint(n, n, 8 / n ** 2))),
      0.25,
    )
    expect(columns.guide).toEqual([2, 1, 0.5])
    expect(columns.error).toEqual([8, 2, 0.5])
    expect(columns.target).toEqual([0.25, 0.25, 0.25])
  })

  it('keeps what a logarithmic axis cannot show away from it', () => {
    const columns = errorColumns([toPoint(wirePoint(1, 0, 1)), toPoint(wirePoint(2, 10, 0))], null)
    expect(columns.mutations).toEqual([10])
    expect(columns.error).toEqual([null])
    expect(columns.guide).toEqual([null])
    expect(columns.target).toEqual([null])
  })
})

it('toEvent keeps what an event carries', () => {
  const event = toEvent({ sequence: 1, kind: 'round', convergence: wirePoint(1, 5, 1) })
  expect([event.kind, event.job, event.point?.mutations]).toEqual(['round', null, 5])
})

it('toWorker tells what a worker does', () => {
  const worker = toWorker({
    id: 'w',
    name: 'n',
    threads: 4,
    state: 'busy',
    leased_segments: 8,
    mutations_per_second: 1_500_000,
  })
  expect(worker.detail).toBe('1.5 M/s, 8 segments')
})

it('metric and duration', () => {
  expect([0, 999, 999.7, 12_345, 5e15].map(metric)).toEqual(['0', '999', '1 k', '12.3 k', '5000 T'])
  expect([0.2, 59.5, 3725].map(duration)).toEqual(['1 s', '1 min 00 s', '1 h 02 min'])
})

describe('toPlan', () => {
  it('tells used features from skipped ones', () => {
    const feature = { name: 'lens', state: 'skipped', evidence: 'a pinhole' }
    expect(toPlan({ features: [feature, { ...feature, state: 'used' }] })).toEqual({
      features: [
        { name: 'lens', used: false, evidence: 'a pinhole' },
        { name: 'lens', used: true, evidence: 'a pinhole' },
      ],
      auto: null,
    })
  })

  it('says what auto chose', () => {
    const plan = toPlan({ features: [], auto: { integrator: 'pssmlt', reason: 'sparks' } })
    expect(plan.auto).toBe('auto chose pssmlt: sparks')
  })
})
