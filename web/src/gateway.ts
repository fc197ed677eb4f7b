// The only file that talks to the coordinator.

import { pause, wait } from './backoff'
import type { Picture } from './image/pixels'
import { parsePFM, toPicture } from './image/pixels'
import type { Worker } from './model/farm'
import { toWorker } from './model/farm'
import type { Job, JobEvent, Plan, Point } from './model/job'
import { toEvent, toJob, toPlan, toPoint } from './model/job'
import type { Message } from './model/sse'
import { MessageParser } from './model/sse'
import type {
  WireEvent,
  WireFarmChange,
  WireInterface,
  WireJob,
  WirePlan,
  WirePoint,
  WireProblem,
  WireRequest,
  WireScene,
  WireSession,
  WireUpload,
  WireWorker,
} from './wire'

export type Action = 'cancel' | 'pause' | 'resume' | 'finish'

/** The server wants to know who asks: there is no session, or it has ended. */
export class Unknown extends Error {}

/** The server refuses; errors name fields. */
export class Refusal extends Error {
  constructor(
    message: string,
    readonly status: number,
    readonly errors: { message?: string; location?: string }[],
  ) {
    super(message)
  }
}

async function call(path: string, init?: RequestInit): Promise<Response> {
  const response = await fetch(path, init)
  if (response.ok) return response
  // A proxy in between may answer without a problem document.
  const problem = (await response.json().catch(() => ({}))) as WireProblem
  const detail = problem.detail ?? problem.title ?? `The server answered ${response.status}.`
  if (response.status === 401) throw new Unknown(detail)
  throw new Refusal(detail, response.status, problem.errors ?? [])
}

async function get<T>(path: string): Promise<T> {
  return (await (await call(path)).json()) as T
}

async function send<T>(method: string, path: string, body?: unknown, type = 'json'): Promise<T> {
  const init: RequestInit = { method }
  if (body !== undefined) {
    init.headers = { 'Content-Type': `application/${type}` }
    init.body = JSON.stringify(body)
  }
  return (await (await call(path, init)).json()) as T
}

/** Exchanges a token for a session, which the browser keeps out of reach of this page. */
export async function signIn(token: string): Promise<void> {
  await call('/v1/session', { method: 'POST', headers: { Authorization: `Bearer ${token}` } })
}

export async function signOut(): Promise<void> {
  await call('/v1/session', { method: 'DELETE' })
}

export async function getSession(): Promise<WireSession> {
  return get<WireSession>('/v1/session')
}

export async function getInterface(): Promise<WireInterface> {
  return get<WireInterface>('/openapi.json')
}

const jobPath = (id: string) => `/v1/jobs/${encodeURIComponent(id)}`

const PAGE = 200

/**
 * All jobs up to a number, newest first; each page is told of as it comes. Returns whether there are no
 * more.
 */
export async function listJobs(most: number, onPage: (jobs: WireJob[]) => void): Promise<boolean> {
  let cursor = ''
  for (let read = 0; read < most; read += PAGE) {
    const query = cursor === '' ? '' : `&cursor=${encodeURIComponent(cursor)}`
    const page = await get<{ jobs: WireJob[]; next?: string }>(
      `/v1/jobs?view=brief&limit=${PAGE}${query}`,
    )
    onPage(page.jobs)
    if (page.next === undefined) return true
    cursor = page.next
  }
  return false
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

export async function act(id: string, action: Action): Promise<Job> {
  return toJob(await send<WireJob>('POST', `${jobPath(id)}/${action}`))
}

export async function refine(id: string, stop: Record<string, unknown>): Promise<Job> {
  return toJob(await send<WireJob>('POST', `${jobPath(id)}/refine`, stop))
}

export async function changePriority(id: string, priority: number): Promise<Job> {
  return toJob(await send<WireJob>('PATCH', jobPath(id), { priority }, 'merge-patch+json'))
}

export async function submit(request: WireRequest): Promise<Job> {
  return toJob(await send<WireJob>('POST', '/v1/jobs', request))
}

export async function drain(id: string): Promise<Worker> {
  return toWorker(await send<WireWorker>('POST', `/v1/workers/${encodeURIComponent(id)}/drain`))
}

export async function listScenes(): Promise<WireScene[]> {
  return (await get<{ scenes: WireScene[] }>('/v1/scenes')).scenes
}

export async function upload(bundle: Blob): Promise<WireScene> {
  const response = await call('/v1/scenes', { method: 'POST', body: bundle })
  const { digest, entries, files } = (await response.json()) as WireUpload
  const bytes = files.reduce((sum, file) => sum + file.size, 0)
  return { digest, entries, files: files.length, bytes, used: new Date().toISOString() }
}

export type ImageKind = 'exr' | 'png' | 'pfm'

export function imagePath(id: string, kind: ImageKind, query = ''): string {
  return `${jobPath(id)}/image.${kind}${query}`
}

export async function getPicture(id: string, layer: 'color' | 'variance'): Promise<Picture> {
  const response = await call(imagePath(id, 'pfm', `?layer=${layer}`))
  return toPicture(response.headers, parsePFM(await response.arrayBuffer()))
}

/** How a stream is: it waits for its first answer, brings news, or has been quiet for too long. */
export type Connection = 'connecting' | 'live' | 'lost'

/** Streams that are quiet send a comment every 15 s. */
const SILENCE = 40_000

interface Listener {
  onMessage: (message: Message) => void
  onConnection: (connection: Connection) => void
  onFailure: (error: unknown) => void
}

/**
 * Follows a stream of events until the returned function is called. It connects again by itself and
 * goes on after the last message; only an answer that will not change ends it. A stream that the server
 * ended in order has news elsewhere, of a job that goes on at another coordinator: that is no loss.
 */
function follow(path: string, listener: Listener): () => void {
  const control = new AbortController()
  let lastId = ''
  let failures = 0
  const attempt = async () => {
    const quiet = new AbortController()
    const headers: HeadersInit = lastId === '' ? {} : { 'Last-Event-ID': lastId }
    const signal = AbortSignal.any([control.signal, quiet.signal])
    let timer = setTimeout(quiet.abort.bind(quiet), SILENCE)
    try {
      const response = await call(path, { headers, signal, cache: 'no-store' })
      listener.onConnection('live')
      failures = 0
      const parser = new MessageParser(lastId)
      const reader = response.body?.pipeThrough(new TextDecoderStream()).getReader()
      for (let part = await reader?.read(); part?.done === false; part = await reader?.read()) {
        clearTimeout(timer)
        timer = setTimeout(quiet.abort.bind(quiet), SILENCE)
        for (const message of parser.push(part.value)) {
          lastId = message.id
          listener.onMessage(message)
        }
      }
    } finally {
      clearTimeout(timer)
    }
  }
  const ended = () => control.signal.aborted
  const run = async () => {
    while (!ended()) {
      try {
        await attempt()
        if (ended()) return
        listener.onConnection('connecting')
      } catch (error) {
        if (ended()) return
        if (isFinal(error)) {
          listener.onFailure(error)
          return
        }
        listener.onConnection('lost')
      }
      failures++
      await wait(pause(failures), control.signal)
    }
  }
  listener.onConnection('connecting')
  run().catch(listener.onFailure)
  return () => {
    control.abort()
  }
}

/** Whether a refusal may be another one later: the server has too much to do, or cannot do it now. */
const passes = (status: number) => status >= 500 || [408, 425, 429].includes(status)

/** Whether asking again is of no use. */
export const isFinal = (error: unknown) =>
  error instanceof Unknown || (error instanceof Refusal && !passes(error.status))

type Following<T> = Omit<Listener, 'onMessage'> & { onMessage: (news: T) => void }

export function followJob(id: string, listener: Following<JobEvent>): () => void {
  return follow(`${jobPath(id)}/events`, {
    ...listener,
    onMessage: (message) => {
      listener.onMessage(toEvent(JSON.parse(message.data) as WireEvent))
    },
  })
}

export function followFarm(listener: Following<WireFarmChange>): () => void {
  return follow('/v1/events', {
    ...listener,
    onMessage: (message) => {
      listener.onMessage(JSON.parse(message.data) as WireFarmChange)
    },
  })
}
