// The form of a new job: its fields as the interface describes them, and the request they make. Pure.

import type { WireInterface, WireProperty, WireRequest } from '../wire'

export type FieldKind = 'text' | 'number' | 'switch' | 'choice' | 'list' | 'pairs'

export interface Field {
  /** As in the request, for example stop.time_seconds. */
  name: string
  kind: FieldKind
  choices: string[]
  /** Integrators that it has a meaning for; none: all. */
  integrators: string[]
  text: string
}

/** What was typed, by field; what is absent or empty asks for the default. */
export type Values = Readonly<Record<string, string>>

/** What the form has other means for. */
const NOT_IN_FORM = new Set(['scene', 'entry', 'resolved', 'stop', 'inspect_only'])

/** These come first; the others are folded away. */
export const MAIN_FIELDS = [
  'name',
  'integrator',
  'stop.target_error',
  'stop.time_seconds',
  'stop.mutations_per_pixel',
  'stop.samples_per_pixel',
  'delayed_rejection',
  'priority',
]

export function fieldsOf(document: WireInterface): Field[] {
  const of = (schema: string, prefix: string) =>
    Object.entries(document.components.schemas[schema]?.properties ?? {})
      .filter(([name]) => prefix !== '' || !NOT_IN_FORM.has(name))
      .map(([name, property]) => toField(prefix + name, property))
  const fields = [...of('Request', ''), ...of('StopRules', 'stop.')]
  const rank = (field: Field) => {
    const at = MAIN_FIELDS.indexOf(field.name)
    return at < 0 ? MAIN_FIELDS.length : at
  }
  return fields.sort((a, b) => rank(a) - rank(b))
}

function toField(name: string, property: WireProperty): Field {
  const choices = property['x-choices'] ?? []
  return {
    name,
    kind: kindOf(property, choices),
    choices,
    integrators: property['x-integrators'] ?? [],
    text: property['x-summary'] ?? property.description ?? '',
  }
}

function kindOf(property: WireProperty, choices: string[]): FieldKind {
  const types = [property.type ?? []].flat()
  if (types.includes('array')) return 'list'
  if (types.includes('object')) return 'pairs'
  if (types.includes('boolean')) return 'switch'
  if (choices.length > 0) return 'choice'
  return types.includes('integer') || types.includes('number') ? 'number' : 'text'
}

/** Whether a field has a meaning for what is chosen; auto may choose any integrator. */
export function isFor(field: Field, integrator: string): boolean {
  if (field.integrators.length === 0 || integrator === '' || integrator === 'auto') return true
  return field.integrators.includes(integrator)
}

/** The values that make a request again. */
export function valuesOf(request: WireRequest, fields: readonly Field[]): Record<string, string> {
  const values: Record<string, string> = {}
  for (const { name, kind } of fields) {
    const rule = name.replace(/^stop\./, '')
    const value = rule === name ? request[name] : request.stop?.[rule]
    const text = valueText(value, kind)
    if (text !== '') values[name] = text
  }
  return values
}

function valueText(value: unknown, kind: FieldKind): string {
  if (value === undefined || value === null || value === false) return ''
  if (Array.isArray(value)) return value.join(',')
  if (kind === 'pairs' && typeof value === 'object') {
    return Object.entries(value)
      .map(([name, word]) => `${name}=${String(word)}`)
      .join('\n')
  }
  return typeof value === 'string' ? value : JSON.stringify(value)
}

export function toRequest(
  scene: { digest: string; entry: string },
  values: Values,
  fields: readonly Field[],
): WireRequest {
  const request: WireRequest = { scene: scene.digest, entry: scene.entry }
  const stop: Record<string, unknown> = {}
  const integrator = values['integrator'] ?? ''
  for (const field of fields) {
    const text = (values[field.name] ?? '').trim()
    if (text === '' || !isFor(field, integrator)) continue
    const rule = field.name.replace(/^stop\./, '')
    if (rule === field.name) request[field.name] = parsed(text, field.kind)
    else stop[rule] = parsed(text, field.kind)
  }
  if (Object.keys(stop).length > 0) request.stop = stop
  return request
}

/** What is no number is sent as it is: the server says what is wrong with it. */
function parsed(text: string, kind: FieldKind): unknown {
  switch (kind) {
    case 'number':
      return Number.isFinite(Number(text)) ? Number(text) : text
    case 'switch':
      return text === 'true'
    case 'list':
      return text.split(',').filter(Boolean)
    case 'pairs':
      return Object.fromEntries(
        text.split('\n').map((line) => {
          const at = line.indexOf('=')
          return at < 0 ? [line.trim(), ''] : [line.slice(0, at).trim(), line.slice(at + 1).trim()]
        }),
      )
    case 'text':
    case 'choice':
      return text
  }
}

/** Errors by field, from the locations of a problem document (body.stop.rounds). */
export function errorsByField(
  errors: readonly { message?: string; location?: string }[],
): Record<string, string> {
  const found: Record<string, string> = {}
  for (const { message = '', location = '' } of errors) {
    found[location.replace(/^body\./, '')] = message
  }
  return found
}
