// Ties the gateway to the views: which job is selected, and what to read again when something
// happens. Nothing is polled; events say when.

import { bData, bOptions, Chart, errorData, errorOptions } from './charts'
import type { Action } from './gateway'
import * as gateway from './gateway'
import type { Job, JobEvent, Point } from './model'
import { addPoint } from './model'
import * as views from './views'
import './style.css' // after the chart's own style, which it adjusts

const errorChart = new Chart(views.element('error-chart'), errorOptions)
const bChart = new Chart(views.element('b-chart'), bOptions)

let jobs: Job[] = []
let next: string | null = null
let selected: string | null = null
let job: Job | null = null
let points: Point[] = []
let shownFilm: string | null = null
/** Counts image requests: an answer that a newer request has overtaken is dropped. */
let imageRequest = 0
let unfollow: () => void = () => undefined

/** Runs something that may fail, and shows the reason. */
function attempt(work: () => Promise<void>): void {
  work()
    .then(() => {
      views.showMessage('')
    })
    .catch((error: unknown) => {
      views.showMessage(error instanceof Error ? error.message : String(error))
    })
}

async function refreshLists(): Promise<void> {
  const [page, workers] = await Promise.all([gateway.listJobs(null), gateway.listWorkers()])
  jobs = page.jobs
  next = page.next
  views.showWorkers(workers)
  showList()
}

function showList(): void {
  if (job !== null) jobs = jobs.map((other) => (job?.id === other.id ? job : other))
  views.showJobs(jobs, selected, next !== null)
}

async function olderJobs(): Promise<void> {
  const page = await gateway.listJobs(next)
  jobs = [...jobs, ...page.jobs]
  next = page.next
  showList()
}

async function select(id: string): Promise<void> {
  unfollow()
  selected = id
  shownFilm = null
  points = []
  views.showConnection(null)
  const [fresh, convergence] = await Promise.all([gateway.getJob(id), gateway.getPoints(id)])
  if (selected !== id) return
  points = convergence
  views.showImage(null, '', '')
  take(fresh)
  showCharts()
  attempt(showPlan)
  // A job that has ended sends nothing new.
  if (!fresh.ended) unfollow = gateway.follow(id, receive, views.showConnection)
}

function receive(event: JobEvent): void {
  if (event.job !== null) take(event.job)
  if (event.point !== null) {
    points = addPoint(points, event.point)
    showCharts()
  }
  if (event.kind === 'state' || event.kind === 'round') attempt(refreshLists)
  if (event.kind === 'state') attempt(showPlan)
  if (event.job?.ended) {
    unfollow()
    views.showConnection(null)
  }
}

function take(fresh: Job): void {
  job = fresh
  views.showJob(fresh)
  showList()
  if (fresh.film !== null && fresh.film !== shownFilm) attempt(showImage)
}

function showCharts(): void {
  errorChart.show(errorData(points, job?.target ?? null))
  bChart.show(bData(points))
}

async function showPlan(): Promise<void> {
  if (selected === null) return
  const id = selected
  const plan = await gateway.getPlan(id)
  if (selected === id) views.showPlan(plan)
}

async function showImage(): Promise<void> {
  if (job?.film == null) return
  const { id, film } = job
  shownFilm = film
  const request = ++imageRequest
  const exposure = views.input('auto-exposure').checked
    ? null
    : views.input('exposure').valueAsNumber
  const image = await gateway.getImage(id, exposure)
  if (request !== imageRequest || selected !== id) return
  views.showImage(image, gateway.imagePath(id, 'exr', null), gateway.imagePath(id, 'png', exposure))
}

function changeExposure(): void {
  const auto = views.input('auto-exposure').checked
  const exposure = views.input('exposure')
  exposure.disabled = auto
  views.element('exposure-text').textContent = auto ? '' : `${exposure.value} stops`
  attempt(showImage)
}

function act(action: Action): void {
  attempt(async () => {
    if (selected !== null) take(await gateway.act(selected, action))
  })
}

function route(): void {
  const id = decodeURIComponent(location.hash.slice(1))
  if (id !== '') {
    attempt(() => select(id))
  } else if (jobs[0] !== undefined) {
    location.replace(`#${encodeURIComponent(jobs[0].id)}`)
  }
}

for (const action of ['cancel', 'pause', 'resume', 'finish'] as const) {
  views.button(action).addEventListener('click', () => {
    act(action)
  })
}
views.button('refresh').addEventListener('click', () => {
  attempt(refreshLists)
})
views.button('more').addEventListener('click', () => {
  attempt(olderJobs)
})
views.input('auto-exposure').addEventListener('change', changeExposure)
views.input('exposure').addEventListener('change', changeExposure)
window.addEventListener('hashchange', route)
window.addEventListener('focus', () => {
  attempt(refreshLists)
})
attempt(async () => {
  await refreshLists()
  route()
})
