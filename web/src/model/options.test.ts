import { describe, expect, it } from 'vitest'

import type { WireInterface } from '../wire'
import { errorsByField, fieldsOf, isFor, toRequest, valuesOf } from './options'

const document: WireInterface = {
  paths: {},
  components: {
    schemas: {
      Request: {
        properties: {
          scene: { type: 'string' },
          seed: { type: 'integer', 'x-summary': 'another noise' },
          kernel: { type: 'string', 'x-choices': ['a', 'b'], 'x-integrators': ['pssmlt'] },
          lenient: { type: 'boolean' },
          layers: { type: ['array', 'null'], 'x-choices': ['one', 'two'] },
          defaults: { type: 'object' },
          name: { type: 'string' },
          shutter_open: { type: ['number', 'null'] },
          shutter_curve: {},
        },
      },
      StopRules: { properties: { rounds: { type: 'integer' } } },
    },
  },
}
const fields = fieldsOf(document)
const scene = { digest: 'aa', entry: 's.xml' }

it('fieldsOf knows what each option takes; the main ones come first', () => {
  expect(fields[0]?.name).toBe('name')
  expect(new Map(fields.map(({ name, kind }) => [name, kind]))).toEqual(
    new Map([
      ['name', 'text'],
      ['shutter_open', 'number'],
      ['shutter_curve', 'text'],
      ['seed', 'number'],
      ['kernel', 'choice'],
      ['lenient', 'switch'],
      ['layers', 'list'],
      ['defaults', 'pairs'],
      ['stop.rounds', 'number'],
    ]),
  )
})

describe('toRequest', () => {
  const values = {
    seed: ' 7 ',
    kernel: 'b',
    lenient: 'true',
    layers: 'one,two',
    defaults: 'spp=4\nname = x=y',
    'stop.rounds': '3',
    name: '',
  }
  const request = {
    scene: 'aa',
    entry: 's.xml',
    seed: 7,
    kernel: 'b',
    lenient: true,
    layers: ['one', 'two'],
    defaults: { spp: '4', name: 'x=y' },
    stop: { rounds: 3 },
  }

  it('says what was given, and nothing of the rest', () => {
    expect(toRequest(scene, values, fields)).toEqual(request)
    expect(toRequest(scene, {}, fields)).toEqual({ scene: 'aa', entry: 's.xml' })
  })

  it('leaves out what another integrator has no use for', () => {
    expect(toRequest(scene, { kernel: 'b', integrator: 'path' }, fields)).not.toHaveProperty(
      'kernel',
    )
  })

  it('lets the server refuse what is no number', () => {
    expect(toRequest(scene, { seed: 'many' }, fields)['seed']).toBe('many')
  })

  it('is undone by valuesOf', () => {
    expect(toRequest(scene, valuesOf(request, fields), fields)).toEqual(request)
  })

  it('keeps a shutter that opens at 0, with its curve', () => {
    const given = { ...request, shutter_open: 0, shutter_curve: [0, 0.5, 1] }
    const again = toRequest(scene, valuesOf(given, fields), fields)
    expect(again).toEqual({ ...request, shutter_open: 0, shutter_curve: '0,0.5,1' })
  })
})

it('isFor takes any option while the integrator is open', () => {
  const kernel = fields.find(({ name }) => name === 'kernel')
  expect(kernel && ['', 'auto', 'pssmlt', 'path'].map((name) => isFor(kernel, name))).toEqual([
    true,
    true,
    true,
    false,
  ])
})

it('errorsByField names the fields of the form', () => {
  expect(errorsByField([{ message: 'too small', location: 'body.stop.rounds' }])).toEqual({
    'stop.rounds': 'too small',
  })
})
