import { describe, expect, it } from 'vitest'

import { wireJob, wirePoint } from '../testing/wires'
import type { WireJob } from '../wire'
import {
  isBefore,
  mayChange,
  percentOf,
  replayCommand,
  toEvent,
  toJob,
  toldOf,
  toPlan,
  toPoint,
} from './job'

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

describe('mayChange', () => {
  it.each([
    ['read', 'Ann', 'Ann', false],
    ['submit', 'Ann', 'Ann', true],
    ['submit', 'Ann', 'Ben', false],
    ['admin', 'Ann', 'Ben', true],
    ['admin', '', '', true],
  ])('%s of %s, job of %s: %s', (role, user, owner, want) => {
    expect(mayChange({ tokens: user !== '', role, user }, owner)).toBe(want)
  })
})

describe('toJob', () => {
  it('prefers the name to the entry and tells the phase', () => {
    expect(toJob(wireJob()).name).toBe('scene.xml')
    const request = { scene: 'aa', entry: 's.xml', name: 'Ajar' }
    const job = toJob(wireJob({ request, activity: 'merging' }))
    expect(job.name).toBe('Ajar')
    expect(job.phase).toBe('round 3, 4 of 16 segments, merging')
  })

  it('has no time left, no pause and no rate once it has ended', () => {
    const job = toJob(
      wireJob({ state: 'canceled', paused: true, eta_seconds: 9, mutations_per_second: 5 }),
    )
    expect([job.ended, job.paused, job.etaSeconds, job.rate]).toEqual([true, false, null, 0])
  })

  it('leaves out what is not known, and shows intervals of what is', () => {
    const names = (change: Partial<WireJob>) => toJob(wireJob(change)).facts.map(([name]) => name)
    expect(names({})).not.toContain('Relative error')
    const job = toJob(
      wireJob({
        rel_mse: 0.00123,
        rel_mse_interval: { low: 0.001, high: 0.002, level: 0.95 },
        acceptance: { large: 0.4567, second_after_large: 0.1 },
        anomalies: { nan: 2, infinite: 0 },
      }),
    )
    expect(new Map(job.facts).get('Relative error')).toBe('0.00123 (0.001 to 0.002)')
    expect(job.acceptance).toEqual([
      { name: 'Large steps', value: 0.4567 },
      { name: 'Second stage after large', value: 0.1 },
    ])
    expect(job.anomalies).toEqual([{ name: 'nan', value: 2 }])
  })

  it('keeps lengths and techniques apart, and what was not counted empty', () => {
    const job = toJob(
      wireJob({
        lengths: [{ edges: 1, b: 0.5, proposed: 0.25 }, { edges: 2 }],
        techniques: [{ light_vertices: 1, acceptance: 0.5 }],
      }),
    )
    expect(job.lengths[0]).toEqual({
      name: '1 edge',
      b: 0.5,
      probability: null,
      proposed: 0.25,
      acceptance: null,
    })
    expect(job.lengths[1]?.name).toBe('2 edges')
    expect(job.techniques[0]?.acceptance).toBe(0.5)
  })

  it('says why it is done', () => {
    expect(toJob(wireJob({ state: 'done', stop_reason: 'count' })).phase).toBe('all samples taken')
    expect(toJob(wireJob({ state: 'done', stop_reason: 'new rule' })).phase).toBe('new rule')
    expect(toJob(wireJob({ state: 'done' })).phase).toBe('done')
  })

  it('puts error, reason of a pause and warnings into the note', () => {
    const job = toJob(wireJob({ error: 'bad', pause_reason: 'p', warnings: ['w1', 'w2'] }))
    expect(job.note).toBe('bad\np\nw1\nw2')
  })
})

it('points carry a 95 % interval of b', () => {
  const { b } = toPoint(wirePoint(1, 100, 1))
  expect([b.low, b.high]).toEqual([2 - 0.98, 2 + 0.98])
})

it('toEvent keeps what an event carries', () => {
  const event = toEvent({
    sequence: 1,
    kind: 'round',
    at: '2026-01-01T00:00:00Z',
    attributes: { worker: 'w1', round: 3 },
    convergence: wirePoint(1, 5, 1),
  })
  expect([event.kind, event.job, event.point?.mutations]).toEqual(['round', null, 5])
  expect(event.attributes).toEqual({ worker: 'w1', round: '3' })
})

describe('toPlan', () => {
  it('tells used features from skipped ones', () => {
    const feature = { name: 'lens', state: 'skipped', evidence: 'a pinhole' }
    expect(toPlan({ features: [feature, { ...feature, state: 'used' }] })).toEqual({
      features: [
        { name: 'lens', used: false, evidence: 'a pinhole' },
        { name: 'lens', used: true, evidence: 'a pinhole' },
      ],
      choices: [],
      auto: null,
    })
  })

  it('says what auto chose', () => {
    const plan = toPlan({ features: [], auto: { integrator: 'pssmlt', reason: 'sparks' } })
    expect(plan.auto).toBe('auto chose pssmlt: sparks')
  })
})

describe('isBefore', () => {
  const at = (refinements: number, rounds: number) =>
    toJob(wireJob({ refinements, rounds_done: rounds }))

  it('goes by refinements, then by rounds', () => {
    expect(isBefore(at(0, 5), at(1, 4))).toBe(true)
    expect(isBefore(at(1, 4), at(0, 5))).toBe(false)
    expect(isBefore(at(1, 4), at(1, 5))).toBe(true)
    expect(isBefore(at(1, 5), at(1, 5))).toBe(false)
  })
})

it('toldOf keeps the defaults that events leave out, and takes what has changed', () => {
  const jobOf = (request: Record<string, unknown>) =>
    toJob(wireJob({ request: { scene: 'aa', entry: 'scene.xml', ...request } }))
  const known = jobOf({ priority: 1, defaults: { spp: '4' } })
  expect(toldOf(known, jobOf({ priority: 2 })).request).toEqual({
    scene: 'aa',
    entry: 'scene.xml',
    priority: 2,
    defaults: { spp: '4' },
  })
  expect(toldOf(jobOf({}), jobOf({})).request).not.toHaveProperty('defaults')
})

describe('replayCommand', () => {
  const job = toJob(wireJob({ rounds_done: 7 }))

  it('repeats the job up to its round', () => {
    expect(replayCommand(job, 'http://farm', false).split('\n')).toEqual([
      "curl -sSf 'http://farm/v1/jobs/j1/plan' | jq -c .resolved > 'j1.json'",
      "metrofarm submit SCENE --resolved 'j1.json' --rounds 7 --server 'http://farm'",
    ])
  })

  it('shows the token that the shell has, and no other', () => {
    expect(replayCommand(job, 'https://farm', true).split('\n')).toEqual([
      'curl -sSf -H "Authorization: Bearer $METROFARM_TOKEN" ' +
        "'https://farm/v1/jobs/j1/plan' | jq -c .resolved > 'j1.json'",
      "metrofarm submit SCENE --resolved 'j1.json' --rounds 7 --server 'https://farm'",
    ])
  })

  it('lets nothing in a name be a command', () => {
    const odd = toJob(wireJob({ id: "a'b;$(x)", rounds_done: 1 }))
    const [curl = '', submit = ''] = replayCommand(odd, "http://f'; x '", false).split('\n')
    expect(curl).toBe(
      String.raw`curl -sSf 'http://f'\''; x '\''/v1/jobs/a'\''b%3B%24(x)/plan' | ` +
        String.raw`jq -c .resolved > 'a'\''b;$(x).json'`,
    )
    expect(submit).toBe(
      String.raw`metrofarm submit SCENE --resolved 'a'\''b;$(x).json' --rounds 1 ` +
        String.raw`--server 'http://f'\''; x '\'''`,
    )
  })

  it('asks for a round even of a job that has none', () => {
    const fresh = toJob(wireJob({ rounds_done: 0 }))
    expect(replayCommand(fresh, 'http://farm', false)).toContain('--rounds 1 ')
  })
})
