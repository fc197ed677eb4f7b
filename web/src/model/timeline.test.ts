import { describe, expect, it } from 'vitest'

import type { WireEvent } from '../wire'
import { wireJob } from '../testing/wires'
import { toEvent } from './job'
import { timelineOf } from './timeline'

const second = (n: number) => new Date(1_700_000_000_000 + 1000 * n).toISOString()

function event(n: number, kind: string, part: Partial<WireEvent> = {}) {
  return toEvent({ sequence: n, kind, at: second(n), ...part })
}

const state = (n: number, name: string, paused = false) =>
  event(n, 'state', { job: wireJob({ state: name, paused }) })

describe('timelineOf', () => {
  const worker = { worker: 'w1', worker_name: 'anvil' }
  const events = [
    state(0, 'queued'),
    state(1, 'rendering'),
    event(2, 'log', { message: 'worker joins', attributes: worker }),
    event(3, 'round', { message: 'round 1' }),
    state(4, 'rendering', true),
    event(5, 'log', { message: 'worker leaves', attributes: worker }),
    event(6, 'fault', { message: 'bad batch' }),
  ]
  const timeline = timelineOf(events, Date.parse(second(10)))
  const spans = timeline?.spans.map(({ row, label, from, to }) => [
    row,
    label,
    (from - timeline.start) / 1000,
    ((to ?? 0) - timeline.start) / 1000,
  ])

  it('has the phases one after the other, the last until now', () => {
    expect(spans?.filter(([row]) => row === 'phase')).toEqual([
      ['phase', 'queued', 0, 1],
      ['phase', 'rendering', 1, 4],
      ['phase', 'paused', 4, 10],
    ])
  })

  it('shows when which worker was there', () => {
    expect(timeline?.rows.map(({ label }) => label)).toEqual(['Phase', 'Rounds', 'anvil', 'Faults'])
    expect(spans?.find(([row]) => row === 'w1')).toEqual(['w1', 'at work', 2, 5])
  })

  it('marks rounds and faults', () => {
    expect(timeline?.marks.map(({ row, bad }) => [row, bad])).toEqual([
      ['rounds', false],
      ['faults', true],
    ])
  })

  it('ends with the job', () => {
    const ended = timelineOf([...events, state(8, 'done')], Date.parse(second(100)))
    expect(ended?.end).toBe(Date.parse(second(8)))
  })

  it('ends the row of a worker that is lost, which faults call by its id alone', () => {
    const lost = timelineOf(
      [
        event(0, 'log', { message: 'worker joins', attributes: worker }),
        event(4, 'fault', {
          message: 'worker w1 is lost with 2 task(s)',
          attributes: { worker: 'w1' },
        }),
      ],
      Date.parse(second(9)),
    )
    expect(lost?.rows.map(({ label }) => label)).toContain('anvil')
    expect(lost?.spans.find(({ row }) => row === 'w1')?.to).toBe(Date.parse(second(4)))
    expect(lost?.marks.map(({ row, bad }) => [row, bad])).toEqual([
      ['faults', true],
      ['w1', true],
    ])
  })

  it('has workers join anew with each owner', () => {
    const owned = (n: number, epoch: number) =>
      event(n, 'log', {
        message: 'worker joins',
        attributes: worker,
        epoch,
        coordinator: `c${epoch}`,
      })
    const taken = timelineOf([owned(0, 1), owned(5, 2)], Date.parse(second(7)))
    const of = (key: string) =>
      taken?.spans
        .filter(({ row }) => row === key)
        .map(({ from, to }) => [from - taken.start, (to ?? 0) - taken.start])
    expect(of('w1')).toEqual([
      [0, 5000],
      [5000, 7000],
    ])
    expect(of('owners')).toEqual(of('w1'))
    expect(taken?.rows.map(({ label }) => label)).toContain('Coordinator')
  })

  it('gives those of one name one row, unless they are there at once', () => {
    const joins = (n: number, id: string) =>
      event(n, 'log', { message: 'worker joins', attributes: { worker: id, worker_name: 'anvil' } })
    const leaves = event(2, 'log', { message: 'worker leaves', attributes: { worker: 'w1' } })
    const labels = (events: ReturnType<typeof joins>[]) =>
      timelineOf(events, Date.parse(second(9)))?.rows.filter(({ label }) => label === 'anvil')
    expect(labels([joins(1, 'w1'), leaves, joins(3, 'w2')])?.length).toBe(1)
    expect(labels([joins(1, 'w1'), joins(3, 'w2')])?.length).toBe(2)
  })

  it('knows of a worker whose beginning is no longer in the log', () => {
    const left = event(5, 'log', { message: 'worker leaves', attributes: worker })
    const rest = timelineOf([event(2, 'round'), left], Date.parse(second(9)))
    expect(rest?.spans.filter(({ row }) => row === 'w1')).toEqual([
      { row: 'w1', label: 'at work', from: Date.parse(second(2)), to: Date.parse(second(5)) },
    ])
  })

  it('is nothing without events', () => {
    expect(timelineOf([], 0)).toBeNull()
  })
})
