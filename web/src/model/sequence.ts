// The frames of a sequence among the jobs that are known. Pure.

import type { Farm } from './farm'
import type { Job } from './job'

export interface Frame {
  number: number
  job: Job
}

/** In the order of their numbers. */
export function framesOf(farm: Farm, sequence: string): Frame[] {
  const frames: Frame[] = []
  for (const job of farm.jobs.values()) {
    if (job.sequence?.id === sequence) frames.push({ number: job.sequence.frame, job })
  }
  return frames.sort((a, b) => a.number - b.number)
}

/** How far the frames are, in words: those that are done, then what else has ended. */
export function summaryOf(frames: readonly Frame[]): string {
  const count = (state: string) => frames.filter(({ job }) => job.state === state).length
  const ended = ['failed', 'canceled'].map((state) => [state, count(state)] as const)
  return [
    `${count('done')} of ${frames.length} done`,
    ...ended.filter(([, n]) => n > 0).map(([state, n]) => `${n} ${state}`),
  ].join(', ')
}
