import { describe, expect, it } from 'vitest'

import { pause, persist } from './backoff'

describe('pause', () => {
  it('grows to a bound, half of it by chance', () => {
    expect([1, 2, 3, 4, 5, 50].map((n) => pause(n, 1))).toEqual([
      1000, 2000, 4000, 8000, 15000, 15000,
    ])
    expect(pause(1, 0)).toBe(500)
    expect(pause(9, 0)).toBe(7500)
  })
})

describe('persist', () => {
  const refused = new Error('refused')

  function trial(failures: number, lastError?: Error) {
    const told: boolean[] = []
    const waits: number[] = []
    const control = new AbortController()
    let attempts = 0
    const result = persist(
      () => {
        attempts++
        if (attempts <= failures) return Promise.reject(new Error('away'))
        return lastError ? Promise.reject(lastError) : Promise.resolve('there')
      },
      {
        signal: control.signal,
        isFinal: (error) => error === refused,
        onAttempt: (failed) => told.push(failed),
        wait: (milliseconds) => {
          waits.push(milliseconds)
          if (waits.length === 20) control.abort()
          return Promise.resolve()
        },
      },
    )
    return { result, told, waits }
  }

  it('tries again, later and later, and says how it goes', async () => {
    const { result, told, waits } = trial(3)
    expect(await result).toBe('there')
    expect(told).toEqual([true, true, true, false])
    expect(waits.map((w) => w > 0)).toEqual([true, true, true])
    expect(waits[2]).toBeGreaterThan(waits[0] ?? Infinity)
  })

  it('gives up what is final, and what nobody wants any more', async () => {
    const final = trial(1, refused)
    await expect(final.result).rejects.toBe(refused)
    expect(final.told).toEqual([true, false])
    const ended = trial(100)
    expect(await ended.result).toBe(null)
    expect(ended.told.at(-1)).toBe(false)
  })
})
