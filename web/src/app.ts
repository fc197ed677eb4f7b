// Ties the gateway to the views: which page is shown, which stream it follows, and what to read again
// when something happens. Nothing is polled; events say when.

import * as gateway from './gateway'
import type { Pixels } from './image/pixels'
import { fromSRGB, keepRound, parsePFM } from './image/pixels'
import { addPoint } from './model/convergence'
import { addListed, applyChange, putJob } from './model/farm'
import type { Job, JobEvent } from './model/job'
import { fieldsOf } from './model/options'
import type { Route } from './model/route'
import { formatRoute, parseRoute } from './model/route'
import type { Actions, JobPage, State } from './state'
import { emptyPage, startState } from './state'
import { Store } from './store'

/** Jobs of the list at most, the newest. */
const MAX_JOBS = 2000
/** Events that the log shows at most. */
const MAX_EVENTS = 600
/** Bytes of images of earlier rounds. */
const IMAGE_BUDGET = 192 << 20
/** Milliseconds for which events are gathered before they are shown. */
const GATHER = 60

export class App {
  readonly store = new Store<State>(startState)
  private unfollow: () => void = () => undefined
  private gathered: JobEvent[] = []
  private gathering = false
  private fetchingImage = false
  private readonly fetchingCurves = new Set<string>()

  readonly actions: Actions = {
    go: (route) => {
      location.hash = formatRoute(route)
    },
    act: (id, action) => {
      this.attempt(async () => {
        this.takeJob(await gateway.act(id, action))
      })
    },
    refine: (id, stop) => {
      this.attempt(async () => {
        this.takeJob(await gateway.refine(id, stop))
        this.followJob(id)
      })
    },
    changePriority: (id, priority) => {
      this.attempt(async () => {
        this.takeJob(await gateway.changePriority(id, priority))
      })
    },
    drain: (id) => {
      this.attempt(async () => {
        const worker = await gateway.drain(id)
        const { farm } = this.state
        this.set({ farm: { ...farm, workers: new Map(farm.workers).set(id, worker) } })
      })
    },
    setQuery: (change) => {
      this.set({ query: { ...this.state.query, ...change } })
    },
    pick: (id, picked) => {
      const next = new Set(this.state.picked)
      if (picked) next.add(id)
      else next.delete(id)
      this.set({ picked: next })
    },
    submit: async (request) => {
      const job = await gateway.submit(request)
      this.set({ farm: putJob(this.state.farm, job) })
      this.actions.go({ page: 'job', id: job.id })
    },
    upload: async (bundle) => {
      const scene = await gateway.upload(bundle)
      const others = this.state.scenes.filter(({ digest }) => digest !== scene.digest)
      this.set({ scenes: [scene, ...others] })
      return scene
    },
    loadImage: gateway.getPixels,
    loadFile: readImage,
    signIn: (token) => {
      gateway.signIn(token).then(
        () => {
          this.set({ login: { open: false, problem: '' } })
          this.start()
        },
        (error: unknown) => {
          this.set({ login: { open: true, problem: textOf(error) } })
        },
      )
    },
    signOut: () => {
      this.attempt(async () => {
        await gateway.signOut()
        location.reload() // nothing of what was shown stays
      })
    },
    dismiss: () => {
      this.set({ message: '' })
    },
  }

  private get state(): State {
    return this.store.get()
  }

  private set(change: Partial<State>): void {
    this.store.set(change)
  }

  /** Reads who we are and what the server can do, then shows the page of the address. */
  start(): void {
    this.attempt(async () => {
      this.set({ session: await gateway.getSession() })
      this.route()
      const document = await gateway.getInterface()
      this.set({
        fields: fieldsOf(document),
        canRefine: '/v1/jobs/{id}/refine' in document.paths,
      })
    })
  }

  route(): void {
    const route = parseRoute(location.hash)
    this.set({ route, message: '' })
    this.unfollow()
    if (route.page === 'job') this.openJob(route.id)
    else this.openFarm(route)
  }

  private openFarm(route: Route): void {
    this.set({ page: null })
    this.unfollow = gateway.followFarm({
      onMessage: (change) => {
        this.set({ farm: applyChange(this.state.farm, change) })
        if (change.full) this.attempt(() => this.readList())
        this.readCurves()
      },
      onConnection: this.onConnection,
      onFailure: this.fail,
    })
    if (route.page === 'submit') {
      this.attempt(async () => {
        this.set({ scenes: await gateway.listScenes() })
      })
      if (route.clone !== null) this.readJob(route.clone)
    }
    if (route.page === 'compare') {
      this.set({ picked: new Set(route.ids) })
      for (const id of route.ids) this.readJob(id)
    }
  }

  private async readList(): Promise<void> {
    await gateway.listJobs(MAX_JOBS, (jobs) => {
      this.set({ farm: addListed(this.state.farm, jobs) })
    })
    this.set({ listed: true })
    this.readCurves()
  }

  private readJob(id: string): void {
    this.attempt(async () => {
      this.set({ farm: putJob(this.state.farm, await gateway.getJob(id)) })
      this.readCurves()
    })
  }

  /** Reads curves of compared jobs that have more rounds than are known. */
  private readCurves(): void {
    const { route, farm, curves } = this.state
    if (route.page !== 'compare') return
    for (const id of route.ids) {
      const rounds = farm.jobs.get(id)?.rounds ?? 0
      const known = curves.get(id)
      if ((known !== undefined && known.length >= rounds) || this.fetchingCurves.has(id)) continue
      this.fetchingCurves.add(id)
      this.attempt(async () => {
        try {
          const points = await gateway.getPoints(id)
          this.set({ curves: new Map(this.state.curves).set(id, points) })
        } finally {
          this.fetchingCurves.delete(id)
        }
      })
    }
  }

  private openJob(id: string): void {
    this.set({ page: emptyPage(id), connection: null })
    this.gathered = []
    this.attempt(async () => {
      const [job, points] = await Promise.all([gateway.getJob(id), gateway.getPoints(id)])
      if (this.page(id) === null) return
      this.setPage(id, { points })
      this.takeJob(job)
      this.followJob(id)
      await this.readPlan(id)
    })
  }

  private followJob(id: string): void {
    this.unfollow()
    this.setPage(id, { events: [] })
    this.unfollow = gateway.followJob(id, {
      onMessage: (event) => {
        this.gathered.push(event)
        if (this.gathering) return
        this.gathering = true
        setTimeout(() => {
          this.gathering = false
          this.flush(id)
        }, GATHER)
      },
      onConnection: this.onConnection,
      onFailure: this.fail,
    })
  }

  /** Shows the events that have been gathered; of their snapshots, the last. */
  private flush(id: string): void {
    const page = this.page(id)
    const events = this.gathered
    this.gathered = []
    if (page === null) return
    let { points } = page
    for (const { point } of events) if (point !== null) points = addPoint(points, point)
    const told = events
      .filter(({ kind }) => kind !== 'progress' && kind !== 'image')
      .map((event) => ({ ...event, job: null }))
    this.setPage(id, { points, events: [...page.events, ...told].slice(-MAX_EVENTS) })
    const last = events.findLast(({ job }) => job !== null)?.job
    // Past events come first: what they tell must not undo what is known.
    if (last && (page.job === null || last.rounds >= page.job.rounds)) this.takeJob(last)
    if (events.some(({ kind }) => kind === 'state')) this.attempt(() => this.readPlan(id))
  }

  private async readPlan(id: string): Promise<void> {
    this.setPage(id, { plan: await gateway.getPlan(id) })
  }

  private takeJob(job: Job): void {
    this.set({ farm: putJob(this.state.farm, job) })
    this.setPage(job.id, { job })
    this.readImage(job.id)
  }

  /** Reads the image if there is a newer one, one at a time. */
  private readImage(id: string): void {
    const page = this.page(id)
    const job = page?.job
    if (!page || !job?.film || job.rounds === page.round || this.fetchingImage) return
    this.fetchingImage = true
    this.attempt(async () => {
      try {
        const image = await gateway.getPixels(id, 'color')
        const { rounds } = this.page(id) ?? page
        const kept = keepRound(rounds, job.rounds, image, IMAGE_BUDGET)
        this.setPage(id, { image, round: job.rounds, rounds: kept })
      } finally {
        this.fetchingImage = false
      }
      this.readImage(this.state.page?.id ?? id)
    })
  }

  private page(id: string): JobPage | null {
    const { page } = this.state
    return page?.id === id ? page : null
  }

  private setPage(id: string, change: Partial<JobPage>): void {
    const page = this.page(id)
    if (page !== null) this.set({ page: { ...page, ...change } })
  }

  private readonly onConnection = (connection: gateway.Connection) => {
    this.set({ connection })
  }

  private readonly fail = (error: unknown) => {
    if (error instanceof gateway.Unknown) {
      this.set({ login: { open: true, problem: '' } })
    } else {
      this.set({ message: textOf(error) })
    }
  }

  /** Runs something that may fail, and shows the reason. */
  private attempt(work: () => Promise<void>): void {
    work().catch(this.fail)
  }
}

/** What a refusal is about is in its list of fields; the message alone says little. */
function textOf(error: unknown): string {
  if (error instanceof gateway.Refusal && error.errors.length > 0) {
    return error.errors
      .map(({ location = '', message = '' }) => `${location.replace(/^body\./, '')}: ${message}`)
      .join('; ')
  }
  return error instanceof Error ? error.message : String(error)
}

/** Reads an image file: a portable float map, or what the browser can decode. */
async function readImage(file: File): Promise<Pixels> {
  if (/\.pfm$/i.test(file.name)) return parsePFM(await file.arrayBuffer())
  const bitmap = await createImageBitmap(file)
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height)
  const context = canvas.getContext('2d')
  if (context === null) throw new Error('this browser has no canvas')
  context.drawImage(bitmap, 0, 0)
  const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height)
  return fromSRGB(bitmap.width, bitmap.height, data)
}
