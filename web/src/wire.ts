// What the coordinator sends, field by field as in /openapi.json. Only the model reads these types.

export interface WireInterval {
  low: number
  high: number
  level: number
}

/** A request; options beside these are passed on as they are. */
export interface WireRequest {
  name?: string
  scene: string
  entry: string
  priority?: number
  stop?: { target_error?: number; [option: string]: unknown }
  [option: string]: unknown
}

interface WireGroup {
  b?: number
  probability?: number
  proposed?: number
  acceptance?: number
}

export interface WireAcceptance {
  large?: number
  small?: number
  subpath?: number
  second?: number
  second_after_large?: number
}

export interface WireJob {
  id: string
  user?: string
  /** What it is a frame of. */
  sequence?: { id: string; frame: number }
  request: WireRequest
  state: string
  paused: boolean
  pause_reason?: string
  queue_position?: number
  error?: string
  created_at: string
  stop_reason?: string
  integrator?: string
  width?: number
  height?: number
  seed: number
  refinements?: number
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
  acceptance: WireAcceptance
  coordinates_per_mutation?: number
  lengths?: ({ edges: number } & WireGroup)[]
  techniques?: ({ light_vertices: number } & WireGroup)[]
  effective_samples?: number
  effective_samples_per_mutation?: number
  longest_stay?: number
  trapped_chains?: number
  anomalies: Record<string, number> | null
  film_sha256?: string
  warnings?: string[]
  stale?: boolean
}

export interface WirePoint {
  round: number
  mutations: number
  rel_mse: number
  rel_mse_interval: WireInterval
  b: number
  b_standard_error: number
  cpu_seconds: number
  wall_seconds: number
  acceptance: WireAcceptance
  effective_samples?: number
}

export interface WirePlan {
  features: { name: string; state: string; evidence: string }[]
  choices?: { name: string; value: string; source: string; why: string }[]
  auto?: { integrator: string; reason: string }
}

export interface WireEvent {
  sequence: number
  kind: string
  at: string
  message?: string
  coordinator?: string
  epoch?: number
  attributes?: Record<string, unknown>
  /** Without request.defaults. */
  job?: WireJob
  convergence?: WirePoint
}

export interface WireWorker {
  id: string
  name: string
  version: string
  threads: number
  state: string
  last_contact: string
  leased_segments: number
  activity?: string
  mutations_per_second: number
  conflicts: number
  exclusion?: string
}

export interface WireFarmChange {
  full: boolean
  jobs: WireJob[]
  workers: WireWorker[]
  gone: string[]
}

export interface WireScene {
  digest: string
  entries: string[]
  files: number
  bytes: number
  used: string
}

export interface WireUpload {
  digest: string
  entries: string[]
  files: { size: number }[]
}

export interface WireSession {
  tokens: boolean
  user: string
  role: string
}

export interface WireProblem {
  detail?: string
  title?: string
  errors?: { message?: string; location?: string }[]
}

export interface WireProperty {
  type?: string | string[]
  description?: string
  'x-choices'?: string[]
  'x-integrators'?: string[]
  'x-summary'?: string
}

/** The part of the OpenAPI document that the form is made of. */
export interface WireInterface {
  paths: Record<string, Record<string, unknown>>
  components: { schemas: Record<string, { properties?: Record<string, WireProperty> }> }
}
