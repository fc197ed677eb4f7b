// Trying again what failed, later and later, and not all pages at the same time.

const FIRST = 1000
const LONGEST = 15_000

/**
 * Milliseconds to wait before what has failed so often in a row (from 1) is tried again. Half of them
 * is up to chance: pages that lost the same server do not all come back at once.
 */
export function pause(failures: number, chance = Math.random()): number {
  return Math.min(LONGEST, FIRST * 2 ** (failures - 1)) * (0.5 + 0.5 * chance)
}

export interface Persistence {
  /** Ends the attempts. */
  signal: AbortSignal
  /** Whether an error will not go away. */
  isFinal: (error: unknown) => boolean
  /** Told after each attempt whether it failed in a way that will go away. */
  onAttempt: (failed: boolean) => void
  wait: (milliseconds: number, signal: AbortSignal) => Promise<void>
}

/** Does something until it succeeds; throws what is final, and nothing once it is ended. */
export async function persist<T>(work: () => Promise<T>, by: Persistence): Promise<T | null> {
  for (let failures = 1; !by.signal.aborted; failures++) {
    try {
      const result = await work()
      by.onAttempt(false)
      return result
    } catch (error) {
      if (by.isFinal(error)) {
        by.onAttempt(false)
        throw error
      }
      by.onAttempt(true)
    }
    await by.wait(pause(failures), by.signal)
  }
  by.onAttempt(false)
  return null
}

/** Waits, at most until the browser is connected again. */
export function wait(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const done = () => {
      clearTimeout(timer)
      window.removeEventListener('online', done)
      signal.removeEventListener('abort', done)
      resolve()
    }
    const timer = setTimeout(done, milliseconds)
    window.addEventListener('online', done)
    signal.addEventListener('abort', done)
  })
}
