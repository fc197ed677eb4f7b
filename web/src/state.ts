// What the page knows, and what can be asked of it.

import type { Action, Connection } from './gateway'
import type { Picture, Pixels } from './image/pixels'
import type { Farm, JobQuery } from './model/farm'
import { emptyFarm, startQuery } from './model/farm'
import type { Job, JobEvent, Plan, Point } from './model/job'
import type { Field } from './model/options'
import type { Route } from './model/route'
import type { WireRequest, WireScene, WireSession } from './wire'

/** The job that is looked at. */
export interface JobPage {
  id: string
  job: Job | null
  points: Point[]
  plan: Plan | null
  events: JobEvent[]
  image: Picture | null
  /** Images of this and earlier rounds. */
  rounds: ReadonlyMap<number, Pixels>
  /** Whether it was deleted while it was looked at. */
  deleted: boolean
}

export interface State {
  session: WireSession | null
  /** Whether a token is asked for, and what was wrong with the last. */
  login: { open: boolean; problem: string }
  connection: Connection | null
  /** What could not be read and is being tried again: what is shown of it may be old. */
  unread: ReadonlySet<string>
  message: string
  route: Route
  farm: Farm
  /** Whether all pages of the list have been read. */
  listed: boolean
  query: JobQuery
  picked: ReadonlySet<string>
  page: JobPage | null
  curves: ReadonlyMap<string, Point[]>
  scenes: WireScene[]
  fields: Field[]
  canRefine: boolean
}

export const startState: State = {
  session: null,
  login: { open: false, problem: '' },
  connection: null,
  unread: new Set(),
  message: '',
  route: { page: 'farm' },
  farm: emptyFarm,
  listed: false,
  query: startQuery,
  picked: new Set(),
  page: null,
  curves: new Map(),
  scenes: [],
  fields: [],
  canRefine: false,
}

export const emptyPage = (id: string): JobPage => ({
  id,
  job: null,
  points: [],
  plan: null,
  events: [],
  image: null,
  rounds: new Map(),
  deleted: false,
})

/** What views may ask for. */
export interface Actions {
  go: (route: Route) => void
  act: (id: string, action: Action) => void
  drain: (id: string) => void
  refine: (id: string, stop: Record<string, unknown>) => void
  changePriority: (id: string, priority: number) => void
  setQuery: (change: Partial<JobQuery>) => void
  pick: (id: string, picked: boolean) => void
  submit: (request: WireRequest) => Promise<void>
  upload: (bundle: Blob) => Promise<WireScene>
  /** Tries again until it succeeds; null once another page is shown. */
  loadImage: (id: string, layer: 'color' | 'variance') => Promise<Picture | null>
  loadFile: (file: File) => Promise<Pixels>
  signIn: (token: string) => void
  signOut: () => void
  dismiss: () => void
}
