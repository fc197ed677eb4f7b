import { describe, expect, it } from 'vitest'

import { wireJob } from '../testing/wires'
import { addListed, emptyFarm } from './farm'
import { framesOf, summaryOf } from './sequence'

const frame = (id: string, sequence: string, number: number, state = 'queued') =>
  wireJob({ id, state, sequence: { id: sequence, frame: number } })

describe('sequences', () => {
  const farm = addListed(emptyFarm, [
    frame('c', 'seq-1', 10),
    frame('a', 'seq-1', 2, 'done'),
    wireJob({ id: 'alone' }),
    frame('x', 'seq-2', 1),
    frame('b', 'seq-1', 9, 'failed'),
  ])

  it('have their frames in order', () => {
    expect(framesOf(farm, 'seq-1').map(({ number, job }) => [number, job.id])).toEqual([
      [2, 'a'],
      [9, 'b'],
      [10, 'c'],
    ])
    expect(framesOf(farm, 'seq-3')).toEqual([])
  })

  it('say how far they are', () => {
    expect(summaryOf(framesOf(farm, 'seq-1'))).toBe('1 of 3 done, 1 failed')
    expect(summaryOf(framesOf(farm, 'seq-2'))).toBe('0 of 1 done')
  })
})
