// One value that changes, and who wants to know.

import { useEffect, useState } from 'preact/hooks'

export class Store<T extends object> {
  private readonly listeners = new Set<() => void>()

  constructor(private value: T) {}

  get(): T {
    return this.value
  }

  set(change: Partial<T>): void {
    this.value = { ...this.value, ...change }
    for (const listener of this.listeners) listener()
  }

  subscribe(listener: () => void): () => void {
    this.listeners.add(listener)
    return () => {
      this.listeners.delete(listener)
    }
  }
}

/** The store's value; the component is drawn again when it changes. */
export function useStore<T extends object>(store: Store<T>): T {
  const [value, setValue] = useState(store.get())
  useEffect(() => {
    const update = () => {
      setValue(store.get())
    }
    update()
    return store.subscribe(update)
  }, [store])
  return value
}

/** The time, told anew every few seconds to those who show how long ago something was. */
export function useNow(seconds: number): number {
  const [now, setNow] = useState(Date.now())
  useEffect(() => {
    const timer = setInterval(() => {
      setNow(Date.now())
    }, 1000 * seconds)
    return () => {
      clearInterval(timer)
    }
  }, [seconds])
  return now
}
