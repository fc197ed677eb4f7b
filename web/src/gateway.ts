// The only file that talks to the coordinator.

import type { Job, JobEvent, Plan, Point, Worker } from './model'
import { toEvent, toJob, toPlan, toPoint, toWorker } from './model'
import type { WireEvent, WireJob, WirePlan, WirePoint, WireProblem, WireWorker } from './wire'

export type Action = 'cancel' | 'pause' | 'resume' | 'finish'

/** Kinds of events that the coordinator sends. */
const KINDS = ['state', 'progress', 'round', 'image', 'warning', 'fault', 'anomaly']

async function call(path: string, init?: RequestInit): Promise<Response> {
  const response = await fetch(path, init)
  if (response.ok) return response
  // A proxy in between may answer without a problem document.
  const problem = (await response.json().catch(() => ({}))) as WireProblem
  throw new Error(problem.detail ?? problem.title ?? `The server answered ${response.status}.`)
}

async function get<T>(path: string): Promise<T> {
  return (await (await call(path)).json()) as T
}

const jobPath = (id: string) => `/v1/jobs/${encodeURIComponent(id)}`

export interface JobPage {
  jobs: Job[]
  next: string | null
}

export async function listJobs(cursor: string | null): Promise<JobPage> {
  const query = cursor === null ? '' : `?cursor=${encodeURIComponent(cursor)}`
  const page = await get<{ jobs: WireJob[]; next?: string }>(`/v1/jobs${query}`)
  return { jobs: page.jobs.map(toJob), next: page.next ?? null }
}

export async function getJob(id: string): Promise<Job> {
  return toJob(await get<WireJob>(jobPath(id)))
}

export async function getPoints(id: string): Promise<Point[]> {
  return (await get<{ points: WirePoint[] }>(`${jobPath(id)}/convergence`)).points.map(toPoint)
}

export async function getPlan(id: string): Promise<Plan> {
  return toPlan(await get<WirePlan>(`${jobPath(id)}/plan`))
}

export async function listWorkers(): Promise<Worker[]> {
  return (await get<{ workers: WireWorker[] }>('/v1/workers')).workers.map(toWorker)
}

export async function act(id: string, action: Action): Promise<Job> {
  const response = await call(`${jobPath(id)}/${action}`, { method: 'POST' })
  return toJob((await response.json()) as WireJob)
}

export function imagePath(id: string, kind: 'exr' | 'png', exposure: number | null): string {
  const query = kind === 'png' && exposure !== null ? `?exposure=${exposure}` : ''
  return `${jobPath(id)}/image.${kind}${query}`
}

export async function getImage(id: string, exposure: number | null): Promise<ImageBitmap> {
  const response = await call(imagePath(id, 'png', exposure))
  return createImageBitmap(await response.blob())
}

/** Follows a job until the returned function is called. The browser reconnects by itself. */
export function follow(
  id: string,
  onEvent: (event: JobEvent) => void,
  onConnection: (open: boolean) => void,
): () => void {
  const source = new EventSource(`${jobPath(id)}/events`)
  const receive = (message: MessageEvent<string>) => {
    onEvent(toEvent(JSON.parse(message.data) as WireEvent))
  }
  for (const kind of KINDS) source.addEventListener(kind, receive)
  source.onopen = () => {
    onConnection(true)
  }
  source.onerror = () => {
    onConnection(false)
  }
  return () => {
    source.close()
  }
}
