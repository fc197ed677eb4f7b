// What the coordinator sends, field by field as in /openapi.json. Only model.ts reads these types.

export interface WireInterval {
  low: number
  high: number
  level: number
}

export interface WireJob {
  id: string
  request: {
    name?: string
    entry: string
    stop?: { target_error?: number }
  }
  state: string
  paused: boolean
  error?: string
  created_at: string
  stop_reason?: string
  integrator?: string
  width?: number
  height?: number
  seed: number
  rounds_done: number
  round_segments: number
  round_segments_done: number
  activity?: string
  progress: number
  eta_seconds?: number
  mutations_per_second: number
  mutations: number
  rays: number
  cpu_seconds: number
  wall_seconds: number
  b: number
  b_standard_error: number
  rel_mse?: number
  rel_mse_interval?: WireInterval
  acceptance: { large?: number; small?: number; second?: number }
  coordinates_per_mutation?: number
  anomalies: Record<string, number> | null
  film_sha256?: string
  warnings?: string[]
}

export interface WirePoint {
  round: number
  mutations: number
  rel_mse: number
  rel_mse_interval: WireInterval
  b: number
  b_standard_error: number
}

export interface WirePlan {
  features: { name: string; state: string; evidence: string }[]
  auto?: { integrator: string; reason: string }
}

export interface WireEvent {
  sequence: number
  kind: string
  message?: string
  job?: WireJob
  convergence?: WirePoint
}

export interface WireWorker {
  id: string
  name: string
  threads: number
  state: string
  leased_segments: number
  activity?: string
  mutations_per_second: number
}

export interface WireProblem {
  detail?: string
  title?: string
}
