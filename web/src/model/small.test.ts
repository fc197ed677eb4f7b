import { describe, expect, it } from 'vitest'

import { ago, bytes, duration, metric } from './format'
import { formatRoute, parseRoute } from './route'
import { MessageParser } from './sse'

describe('numbers', () => {
  it('are short', () => {
    expect([0, 999, 999.7, 12_345, 5e15].map(metric)).toEqual([
      '0',
      '999',
      '1 k',
      '12.3 k',
      '5000 T',
    ])
    expect([0.2, 59.5, 3725, 90_000].map(duration)).toEqual([
      '1 s',
      '1 min 00 s',
      '1 h 02 min',
      '1 d 1 h',
    ])
    expect([1023, 1536, 3 << 20].map(bytes)).toEqual(['1023 B', '1.5 KiB', '3 MiB'])
  })

  it('tell no negative times', () => {
    expect(ago(5000, 1000)).toBe('now')
    expect(ago(0, 61_000)).toBe('1 min ago')
  })
})

describe('routes', () => {
  it.each([
    { page: 'farm' },
    { page: 'job', id: 'a/b %,' },
    { page: 'sequence', id: 'seq-1' },
    { page: 'submit', clone: null },
    { page: 'submit', clone: 'j1' },
    { page: 'compare', ids: ['a', 'b'] },
    { page: 'compare', ids: [] },
  ] as const)('%o survive their address', (route) => {
    expect(parseRoute(formatRoute(route as ReturnType<typeof parseRoute>))).toEqual(route)
  })

  it('lead to the farm where there is nothing', () => {
    for (const hash of ['', '#', '#/', '#/nothing', '#/jobs/']) {
      expect(parseRoute(hash)).toEqual({ page: 'farm' })
    }
    expect(parseRoute('#/jobs/%')).toEqual({ page: 'job', id: '%' })
  })
})

describe('MessageParser', () => {
  const text = 'retry: 1000\n\nid: 7\nevent: round\ndata: {"a":\ndata: 1}\n\n:\n\ndata: x\n\n'
  const want = [
    { id: '7', event: 'round', data: '{"a":\n1}' },
    { id: '7', event: 'message', data: 'x' },
  ]

  it('reads messages however they are cut', () => {
    for (let size = 1; size <= text.length; size += 3) {
      const parser = new MessageParser('')
      const got = []
      for (let i = 0; i < text.length; i += size) got.push(...parser.push(text.slice(i, i + size)))
      expect(got).toEqual(want)
    }
  })

  it('goes on with the last id', () => {
    expect(new MessageParser('3').push('data: y\n\n')[0]?.id).toBe('3')
  })
})
