// Small pieces that several views use.

import type { ComponentChildren } from 'preact'

import type { Job } from '../model/job'
import { shownState } from '../model/job'

/** States are told by a shape, too, not by color alone. */
const SHAPES: Partial<Record<string, string>> = {
  queued: '○',
  inspecting: '◔',
  bootstrapping: '◑',
  rendering: '▶',
  paused: '‖',
  done: '✓',
  failed: '✕',
  canceled: '–',
  busy: '▶',
  idle: '○',
  draining: '↓',
  lost: '✕',
}

export function Badge({ state }: { state: string }) {
  return (
    <span class={`badge ${state}`}>
      <span aria-hidden="true">{SHAPES[state] ?? '·'}</span> <span class="word">{state}</span>
    </span>
  )
}

export const JobBadge = ({ job }: { job: Job }) => <Badge state={shownState(job)} />

export function Bar({ value, label }: { value: number; label: string }) {
  const width = `${Math.max(0, Math.min(100, value))}%`
  return (
    <span class="bar" role="img" aria-label={label}>
      <span style={{ width }} />
    </span>
  )
}

interface CardProps {
  title: string
  tools?: ComponentChildren
  children: ComponentChildren
  class?: string
}

export function Card({ title, tools, children, class: name = '' }: CardProps) {
  return (
    <section class={`card ${name}`}>
      <header>
        <h2>{title}</h2>
        <div class="tools">{tools}</div>
      </header>
      {children}
    </section>
  )
}

interface SelectProps<T extends string> {
  label: string
  value: T
  options: readonly (readonly [T, string])[]
  onChange: (value: T) => void
}

export function Select<T extends string>({ label, value, options, onChange }: SelectProps<T>) {
  const choose = (chosen: string) => {
    const option = options.find(([name]) => name === chosen)
    if (option !== undefined) onChange(option[0])
  }
  return (
    <label class="select">
      <span>{label}</span>
      <select
        aria-label={label}
        value={value}
        onChange={(event) => {
          choose(event.currentTarget.value)
        }}
      >
        {options.map(([name, text]) => (
          <option key={name} value={name}>
            {text}
          </option>
        ))}
      </select>
    </label>
  )
}

/** Saves what was made in the page as a file. */
export function save(content: Blob, name: string): void {
  const link = document.createElement('a')
  link.href = URL.createObjectURL(content)
  link.download = name
  link.click()
  URL.revokeObjectURL(link.href)
}
