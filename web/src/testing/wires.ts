// What a coordinator might send, for tests.

import type { WireJob, WirePoint, WireWorker } from '../wire'

export function wireJob(change: Partial<WireJob> = {}): WireJob {
  return {
    id: 'j1',
    request: { scene: 'aa', entry: 'scene.xml' },
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

export function wirePoint(round: number, mutations: number, error: number): WirePoint {
  return {
    round,
    mutations,
    rel_mse: error,
    rel_mse_interval: { low: error / 2, high: error * 2, level: 0.95 },
    b: 2,
    b_standard_error: 0.5,
    cpu_seconds: 2 * round,
    wall_seconds: round,
    acceptance: {},
  }
}

export function wireWorker(change: Partial<WireWorker> = {}): WireWorker {
  return {
    id: 'w1',
    name: 'n1',
    version: 'v',
    threads: 4,
    state: 'busy',
    last_contact: '2026-01-01T00:00:00Z',
    leased_segments: 8,
    mutations_per_second: 10,
    conflicts: 0,
    ...change,
  }
}
