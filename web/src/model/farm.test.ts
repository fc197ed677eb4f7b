import { describe, expect, it } from 'vitest'

import { wireJob, wireWorker } from '../testing/wires'
import type { WireFarmChange } from '../wire'
import type { JobQuery } from './farm'
import {
  addListed,
  applyChange,
  dropJob,
  dropUnlisted,
  emptyFarm,
  selectJobs,
  sortedWorkers,
  startQuery,
  totalsOf,
} from './farm'

const change = (part: Partial<WireFarmChange>): WireFarmChange => ({
  full: false,
  jobs: [],
  workers: [],
  gone: [],
  ...part,
})

describe('applyChange', () => {
  const start = applyChange(
    addListed(emptyFarm, [wireJob({ id: 'old', state: 'done' }), wireJob({ id: 'j1' })]),
    change({ full: true, jobs: [wireJob({ id: 'j2' })], workers: [wireWorker()] }),
  )

  it('forgets, when it begins anew, what has not ended and is not told of', () => {
    expect([...start.jobs.keys()].sort()).toEqual(['j2', 'old'])
  })

  it('replaces what changed and drops what is gone', () => {
    const next = applyChange(
      start,
      change({ jobs: [wireJob({ id: 'j2', progress: 0.9 })], gone: ['old', 'w1'] }),
    )
    expect([...next.jobs.keys()]).toEqual(['j2'])
    expect(next.jobs.get('j2')?.percent).toBe(90)
    expect(next.workers.size).toBe(0)
    expect(start.workers.size).toBe(1)
  })

  it('is not undone by a list that was read at the same time', () => {
    const next = addListed(start, [wireJob({ id: 'j2', progress: 0.1 }), wireJob({ id: 'j3' })])
    expect(next.jobs.get('j2')?.percent).toBe(50)
    expect(next.jobs.has('j3')).toBe(true)
  })
})

describe('deleted jobs', () => {
  const done = (id: string, second: number) =>
    wireJob({ id, state: 'done', created_at: `2026-01-01T00:00:0${second}Z` })
  const start = addListed(emptyFarm, [done('c', 3), done('b', 2), done('a', 1)])
  const idsOf = ({ jobs }: typeof start) => [...jobs.keys()].sort().join('')

  it('do not come back with a list that was read before', () => {
    const told = applyChange(start, change({ gone: ['b'] }))
    expect(idsOf(addListed(told, [done('b', 2), done('d', 4)]))).toBe('acd')
    expect(idsOf(addListed(dropJob(start, 'c'), [done('c', 3)]))).toBe('ab')
  })

  it('go when a whole list does not have them, but what is new or under way stays', () => {
    const later = addListed(start, [done('n', 9), wireJob({ id: 'l' })])
    expect(idsOf(dropUnlisted(later, start, [done('c', 3), done('a', 1)], true))).toBe('acln')
  })

  it('go only as far as an incomplete list reaches', () => {
    expect(idsOf(dropUnlisted(start, start, [done('c', 3)], false))).toBe('abc')
    expect(idsOf(dropUnlisted(start, start, [done('b', 2)], false))).toBe('ab')
  })
})

describe('selectJobs', () => {
  const farm = addListed(emptyFarm, [
    wireJob({ id: 'a', created_at: '2026-01-01T00:00:01Z', rel_mse: 0.5 }),
    wireJob({ id: 'b', created_at: '2026-01-01T00:00:02Z', paused: true, user: 'Ann' }),
    wireJob({ id: 'c', created_at: '2026-01-01T00:00:03Z', state: 'done', rel_mse: 0.1 }),
  ])
  const ids = (query: Partial<JobQuery>) =>
    selectJobs(farm, { ...startQuery, ...query }).map(({ id }) => id)

  it('shows the newest first', () => {
    expect(ids({})).toEqual(['c', 'b', 'a'])
  })

  it('puts what has no value last, either way', () => {
    expect(ids({ sort: 'error', descending: false })).toEqual(['c', 'a', 'b'])
    expect(ids({ sort: 'error', descending: true })).toEqual(['a', 'c', 'b'])
  })

  it('finds words in any order and states', () => {
    expect(ids({ text: 'ann SCENE' })).toEqual(['b'])
    expect(ids({ state: 'live' })).toEqual(['b', 'a'])
    expect(ids({ state: 'ended' })).toEqual(['c'])
    expect(ids({ state: 'paused' })).toEqual(['b'])
    expect(ids({ state: 'rendering' })).toEqual(['a'])
  })
})

it('totalsOf counts jobs and workers by what they do', () => {
  const farm = applyChange(
    emptyFarm,
    change({
      full: true,
      jobs: [
        wireJob({ id: 'a', mutations_per_second: 5, queue_position: 1 }),
        wireJob({ id: 'b', mutations_per_second: 7, paused: true }),
        wireJob({ id: 'c', state: 'done', mutations_per_second: 9 }),
      ],
      workers: [wireWorker(), wireWorker({ id: 'w2', state: 'lost' })],
    }),
  )
  const totals = totalsOf(farm)
  expect([totals.live, totals.paused, totals.ended, totals.queued]).toEqual([2, 1, 1, 1])
  expect([totals.rate, totals.threads]).toEqual([12, 4])
  expect(totals.workers).toEqual({ busy: 1, idle: 0, draining: 0, lost: 1 })
})

it('sortedWorkers has the busy first and tells what is wrong', () => {
  const farm = applyChange(
    emptyFarm,
    change({
      workers: [
        wireWorker({ id: '1', name: 'b', state: 'lost' }),
        wireWorker({ id: '2', name: 'c', exclusion: 'wrong', conflicts: 2 }),
        wireWorker({ id: '3', name: 'a' }),
      ],
    }),
  )
  const workers = sortedWorkers(farm)
  expect(workers.map(({ name }) => name)).toEqual(['a', 'c', 'b'])
  expect(workers[1]?.note).toBe('wrong; 2 conflicting batches')
})
