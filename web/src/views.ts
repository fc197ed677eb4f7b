// Shows data in the page's elements. Views receive data and hold none.

import type { Job, Plan, Worker } from './model'
import { duration } from './model'

export function element(id: string): HTMLElement {
  const found = document.getElementById(id)
  if (found === null) throw new Error(`the page has no element ${id}`)
  return found
}

function typed<T extends HTMLElement>(id: string, type: new () => T): T {
  const found = element(id)
  if (!(found instanceof type)) throw new Error(`element ${id} is of another kind`)
  return found
}

export const button = (id: string) => typed(id, HTMLButtonElement)
export const input = (id: string) => typed(id, HTMLInputElement)

function make(tag: string, className: string, ...children: (Node | string)[]): HTMLElement {
  const made = document.createElement(tag)
  made.className = className
  made.append(...children)
  return made
}

function badge(state: string): HTMLElement {
  return make('span', `badge ${state}`, state)
}

const stateOf = (job: Job) => (job.paused ? 'paused' : job.state)

export function showJobs(jobs: readonly Job[], selected: string | null, more: boolean): void {
  element('jobs').replaceChildren(
    ...jobs.map((job) => {
      const link = make('a', job.id === selected ? 'selected' : '', make('strong', '', job.name))
      link.setAttribute('href', `#${encodeURIComponent(job.id)}`)
      if (job.id === selected) link.setAttribute('aria-current', 'true')
      link.append(badge(stateOf(job)), make('small', '', `${job.percent} %`))
      return make('li', '', link)
    }),
  )
  element('no-jobs').hidden = jobs.length > 0
  element('more').hidden = !more
}

export function showWorkers(workers: readonly Worker[]): void {
  element('workers').replaceChildren(
    ...workers.map((worker) => {
      const threads = worker.threads === 1 ? '1 thread' : `${worker.threads} threads`
      const detail = [threads, worker.detail].filter(Boolean).join(', ')
      return make(
        'li',
        '',
        make('strong', '', worker.name),
        badge(worker.state),
        make('small', '', detail),
      )
    }),
  )
  element('no-workers').hidden = workers.length > 0
}

export function showJob(job: Job | null): void {
  element('job').hidden = job === null
  element('nothing').hidden = job !== null
  if (job === null) return
  element('job-name').textContent = job.name
  const state = element('job-state')
  state.textContent = stateOf(job)
  state.className = `badge ${stateOf(job)}`
  typed('progress', HTMLProgressElement).value = job.percent
  element('progress-text').textContent = [
    `${job.percent} %`,
    job.phase,
    job.etaSeconds === null ? '' : `${duration(job.etaSeconds)} left`,
  ]
    .filter(Boolean)
    .join(' · ')
  const note = element('job-note')
  note.textContent = job.note
  note.hidden = job.note === ''
  note.className = job.failed ? 'failed' : ''
  showFacts(job.facts)
  showButtons(job)
}

function showFacts(facts: readonly [string, string][]): void {
  element('facts').replaceChildren(
    ...facts.map(([name, text]) => make('div', '', make('dt', '', name), make('dd', '', text))),
  )
}

export function showPlan(plan: Plan): void {
  element('plan').hidden = plan.features.length === 0
  const auto = element('auto')
  auto.textContent = plan.auto ?? ''
  auto.hidden = plan.auto === null
  element('features').replaceChildren(
    ...plan.features.map((feature) =>
      make(
        'tr',
        feature.used ? 'used' : 'skipped',
        make('td', '', feature.name),
        make('td', '', feature.used ? 'used' : 'skipped'),
        make('td', '', feature.evidence),
      ),
    ),
  )
}

function showButtons(job: Job): void {
  element('pause').hidden = job.ended || job.paused
  element('resume').hidden = !job.paused
  button('finish').disabled = job.ended
  button('cancel').disabled = job.ended
}

export function showImage(image: ImageBitmap | null, exr: string, png: string): void {
  const canvas = typed('image', HTMLCanvasElement)
  canvas.hidden = image === null
  element('no-image').hidden = image !== null
  element('image-tools').hidden = image === null
  if (image === null) return
  canvas.width = image.width
  canvas.height = image.height
  canvas.getContext('2d')?.drawImage(image, 0, 0)
  typed('exr', HTMLAnchorElement).href = exr
  typed('png', HTMLAnchorElement).href = png
}

export function showConnection(open: boolean | null): void {
  const shown = element('connection')
  shown.textContent = open === null ? '' : open ? 'live' : 'reconnecting'
  shown.className = open === null ? '' : open ? 'live' : 'lost'
}

export function showMessage(text: string): void {
  const message = element('message')
  message.textContent = text
  message.hidden = text === ''
}
