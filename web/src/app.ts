// Ties the gateway to the views: which page is shown, which stream it follows, and what to read again
// when something happens. Nothing is polled; events say when.

import { persist, wait } from './backoff'
import * as gateway from './gateway'
import type { Pixels } from './image/pixels'
import { fromSRGB, keepRound, parsePFM } from './image/pixels'
import { addPoint } from './model/convergence'
import { addListed, applyChange, dropJob, dropUnlisted, putJob } from './model/farm'
import type { Job, JobEvent } from './model/job'
import { isBefore, toldOf } from './model/job'
import { fieldsOf } from './model/options'
import type { Route } from './model/route'
import { formatRoute, parseRoute } from './model/route'
import type { Actions, JobPage, State } from './state'
import { emptyPage, startState } from './state'
import { Store } from './store'
import type { WireInterface, WireJob, WireSession } from './wire'

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
  /** The film for which an image was asked last; the answer may show a later one. */
  private askedFilm = ''
  /** Ends what the page that is shown still reads. */
  private leaving = new AbortController()
  /** Of what all pages need. */
  private readonly staying = new AbortController()
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
    loadImage: (id, layer) =>
      this.persist(layer === 'variance' ? 'the variance' : 'an image', () =>
        gateway.getPicture(id, layer),
      ),
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
    const showPage = (session: WireSession) => {
      this.set({ session })
      this.route()
      this.read('the interface', gateway.getInterface, takeInterface, this.staying)
    }
    const takeInterface = (document: WireInterface) => {
      this.set({
        fields: fieldsOf(document),
        canRefine: '/v1/jobs/{id}/refine' in document.paths,
      })
    }
    this.read('the session', gateway.getSession, showPage, this.staying)
  }

  route(): void {
    const route = parseRoute(location.hash)
    this.unfollow()
    this.leaving.abort()
    this.leaving = new AbortController()
    this.set({ route, message: '', unread: new Set() })
    if (route.page === 'job') this.openJob(route.id)
    else this.openFarm(route)
  }

  private openFarm(route: Route): void {
    this.set({ page: null })
    this.unfollow = gateway.followFarm({
      onMessage: (change) => {
        const gone = new Set(change.gone)
        const picked = new Set([...this.state.picked].filter((id) => !gone.has(id)))
        this.set({ farm: applyChange(this.state.farm, change), picked })
        if (change.full) this.readList()
        this.readCurves()
      },
      onConnection: this.onConnection,
      onFailure: this.fail,
    })
    if (route.page === 'submit') {
      this.read('the scenes', gateway.listScenes, (scenes) => {
        this.set({ scenes })
      })
      if (route.clone !== null) this.readJob(route.clone)
    }
    if (route.page === 'compare') {
      this.set({ picked: new Set(route.ids) })
      for (const id of route.ids) this.readJob(id)
    }
  }

  private readList(): void {
    const before = this.state.farm
    const read = async () => {
      const listed: WireJob[] = []
      const complete = await gateway.listJobs(MAX_JOBS, (jobs) => {
        listed.push(...jobs)
        this.set({ farm: addListed(this.state.farm, jobs) })
      })
      return { listed, complete }
    }
    this.read('the list of jobs', read, ({ listed, complete }) => {
      this.set({ farm: dropUnlisted(this.state.farm, before, listed, complete), listed: true })
      this.readCurves()
    })
  }

  private readJob(id: string): void {
    this.read(
      'a job',
      () => gateway.getJob(id),
      (job) => {
        this.set({ farm: putJob(this.state.farm, job) })
        this.readCurves()
      },
    )
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
      const read = async () => {
        try {
          return await gateway.getPoints(id)
        } finally {
          this.fetchingCurves.delete(id)
        }
      }
      this.read('a curve', read, (points) => {
        this.set({ curves: new Map(this.state.curves).set(id, points) })
      })
    }
  }

  private openJob(id: string): void {
    this.set({ page: emptyPage(id), connection: null })
    this.gathered = []
    this.fetchingImage = false
    this.askedFilm = ''
    const read = () => Promise.all([gateway.getJob(id), gateway.getPoints(id)])
    this.read('the job', read, ([job, points]) => {
      this.setPage(id, { points })
      this.takeJob(job)
      this.followJob(id)
      this.readPlan(id)
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
      onFailure: (error) => {
        if (error instanceof gateway.Refusal && error.status === 404) this.loseJob(id)
        else this.fail(error)
      },
    })
  }

  /** Shows that a job was deleted; what is known of it stays to be looked at. */
  private loseJob(id: string): void {
    this.unfollow()
    this.set({ farm: dropJob(this.state.farm, id), connection: null })
    this.setPage(id, { deleted: true })
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
    if (last && page.job !== null && !isBefore(last, page.job)) this.takeJob(toldOf(page.job, last))
    if (events.some(({ kind }) => kind === 'deleted')) this.loseJob(id)
    else if (events.some(({ kind }) => kind === 'state')) this.readPlan(id)
  }

  private readPlan(id: string): void {
    this.read(
      'the plan',
      () => gateway.getPlan(id),
      (plan) => {
        this.setPage(id, { plan })
      },
      this.leaving,
      this.failOf(id),
    )
  }

  private takeJob(job: Job): void {
    this.set({ farm: putJob(this.state.farm, job) })
    this.setPage(job.id, { job })
    this.readImage(job.id)
  }

  /** Reads the image if the job has another film than it shows, one at a time. */
  private readImage(id: string): void {
    const film = this.page(id)?.job?.film
    if (!film || film === this.page(id)?.image?.film) return
    if (film === this.askedFilm || this.fetchingImage) return
    this.fetchingImage = true
    this.askedFilm = film
    const { signal } = this.leaving
    this.attempt(async () => {
      try {
        const image = await this.persist('the image', () => gateway.getPicture(id, 'color'))
        const kept = this.page(id)?.rounds
        if (image === null || kept === undefined || signal.aborted) return
        const rounds = keepRound(kept, image.round, image.pixels, IMAGE_BUDGET)
        this.setPage(id, { image, rounds })
      } finally {
        if (!signal.aborted) this.fetchingImage = false
      }
      this.readImage(id)
    }, this.failOf(id))
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

  /** Tells why something of a job could not be read, unless the job was deleted meanwhile. */
  private failOf(id: string): (error: unknown) => void {
    const isMissing = (error: unknown) => error instanceof gateway.Refusal && error.status === 404
    return (error) => {
      if (!isMissing(error)) {
        this.fail(error)
        return
      }
      gateway.getJob(id).then(
        () => {
          this.fail(error)
        },
        (reason: unknown) => {
          if (!isMissing(reason)) this.fail(reason)
          else if (this.page(id) !== null) this.loseJob(id)
        },
      )
    }
  }

  /** Reads something for the page that is shown until that succeeds, and says so meanwhile. */
  private read<T>(
    what: string,
    work: () => Promise<T>,
    take: (result: T) => void,
    { signal }: AbortController = this.leaving,
    fail = this.fail,
  ): void {
    this.attempt(async () => {
      const result = await this.persist(what, work, signal)
      if (result !== null && !signal.aborted) take(result)
    }, fail)
  }

  private persist<T>(
    what: string,
    work: () => Promise<T>,
    signal = this.leaving.signal,
  ): Promise<T | null> {
    const onAttempt = (failed: boolean) => {
      if (signal.aborted || this.state.unread.has(what) === failed) return
      const unread = new Set(this.state.unread)
      if (failed) unread.add(what)
      else unread.delete(what)
      this.set({ unread })
    }
    return persist(work, { signal, isFinal: gateway.isFinal, onAttempt, wait })
  }

  /** Runs something that may fail, and shows the reason. */
  private attempt(work: () => Promise<void>, fail = this.fail): void {
    work().catch(fail)
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
