// A new job: a scene, then options, which the server describes.

import { useEffect, useState } from 'preact/hooks'

import { Refusal } from '../gateway'
import { ago, bytes } from '../model/format'
import type { Job } from '../model/job'
import type { Field } from '../model/options'
import { errorsByField, isFor, MAIN_FIELDS, toRequest, valuesOf } from '../model/options'
import type { Actions, State } from '../state'
import type { WireScene } from '../wire'
import { Card } from './parts'

interface SubmitProps {
  state: State
  actions: Actions
  clone: string | null
}

interface Chosen {
  digest: string
  entry: string
}

export function SubmitPage({ state, actions, clone }: SubmitProps) {
  const [scene, setScene] = useState<Chosen | null>(null)
  const [values, setValues] = useState<Record<string, string>>({})
  const [problem, setProblem] = useState('')
  const [errors, setErrors] = useState<Record<string, string>>({})
  const [busy, setBusy] = useState(false)
  const { fields } = state
  const original = clone === null ? undefined : state.farm.jobs.get(clone)
  useEffect(() => {
    if (original === undefined || fields.length === 0) return
    setScene({ digest: original.request.scene, entry: original.request.entry })
    setValues(valuesOf(original.request, fields))
  }, [original?.id, fields.length])
  const submit = () => {
    if (scene === null) {
      setProblem('Choose a scene first.')
      return
    }
    setBusy(true)
    setErrors({})
    actions.submit(toRequest(scene, values, fields)).catch((error: unknown) => {
      setBusy(false)
      setProblem(error instanceof Error ? error.message : String(error))
      if (error instanceof Refusal) setErrors(errorsByField(error.errors))
    })
  }
  return (
    <form
      class="submit"
      noValidate
      onSubmit={(event) => {
        event.preventDefault()
        submit()
      }}
    >
      <h1>{original === undefined ? 'New job' : `Like ${original.name}, with changes`}</h1>
      <ScenePicker state={state} actions={actions} scene={scene} choose={setScene} />
      <Options
        fields={fields}
        values={values}
        errors={errors}
        set={(name, value) => {
          setValues({ ...values, [name]: value })
        }}
      />
      {problem !== '' && (
        <p class="problem" role="alert">
          {problem}
        </p>
      )}
      <div class="actions">
        <button type="submit" class="primary" disabled={busy || state.session?.role === 'read'}>
          Submit
        </button>
        <small>
          The time to the target error is estimated from the first rounds on; the job’s page shows
          it.
        </small>
      </div>
    </form>
  )
}

interface PickerProps {
  state: State
  actions: Actions
  scene: Chosen | null
  choose: (scene: Chosen) => void
}

function ScenePicker({ state, actions, scene, choose }: PickerProps) {
  const [note, setNote] = useState('')
  const [over, setOver] = useState(false)
  const upload = (file: File | undefined) => {
    if (file === undefined) return
    setNote(`Uploading ${file.name} (${bytes(file.size)})`)
    actions.upload(file).then(
      (stored) => {
        const [entry] = stored.entries
        setNote(entry === undefined ? `${file.name} has no scene file` : `${file.name} is stored`)
        if (entry !== undefined) choose({ digest: stored.digest, entry })
      },
      (error: unknown) => {
        setNote(error instanceof Error ? error.message : String(error))
      },
    )
  }
  return (
    <Card title="Scene">
      <div
        class={`drop ${over ? 'over' : ''}`}
        onDragOver={(event) => {
          event.preventDefault()
          setOver(true)
        }}
        onDragLeave={() => {
          setOver(false)
        }}
        onDrop={(event) => {
          event.preventDefault()
          setOver(false)
          upload(event.dataTransfer?.files[0])
        }}
      >
        <label>
          Drop a bundle here (zip or tar: the scene file and all that it names) or choose one{' '}
          <input
            type="file"
            id="bundle"
            accept=".zip,.tar,.gz,.tgz,.zst"
            onChange={(event) => {
              upload(event.currentTarget.files?.[0])
            }}
          />
        </label>
        <output>{note}</output>
      </div>
      <Scenes
        scenes={state.scenes}
        jobs={[...state.farm.jobs.values()]}
        scene={scene}
        choose={choose}
      />
    </Card>
  )
}

interface ScenesProps {
  scenes: WireScene[]
  jobs: Job[]
  scene: Chosen | null
  choose: (scene: Chosen) => void
}

function Scenes({ scenes, jobs, scene, choose }: ScenesProps) {
  if (scenes.length === 0) return <p class="empty">No scene is stored yet.</p>
  return (
    <fieldset class="scenes" tabIndex={0}>
      <legend>Stored scenes, the latest used first</legend>
      {scenes.flatMap((stored) =>
        stored.entries.slice(0, 4).map((entry) => (
          <label key={stored.digest + entry}>
            <input
              type="radio"
              name="scene"
              checked={scene?.digest === stored.digest && scene.entry === entry}
              onChange={() => {
                choose({ digest: stored.digest, entry })
              }}
            />
            <span>
              {entry} <small>{usersOf(jobs, stored.digest)}</small>
            </span>
            <small>
              {stored.digest.slice(0, 12)} · {stored.files} files, {bytes(stored.bytes)} · used{' '}
              {ago(Date.parse(stored.used), Date.now())}
            </small>
          </label>
        )),
      )}
    </fieldset>
  )
}

/** Names of jobs tell bundles apart whose scene files are called alike. */
function usersOf(jobs: Job[], digest: string): string {
  const names = jobs.filter(({ request }) => request.scene === digest).map(({ name }) => name)
  return [...new Set(names)].slice(0, 3).join(', ')
}

interface OptionsProps {
  fields: Field[]
  values: Record<string, string>
  errors: Record<string, string>
  set: (name: string, value: string) => void
}

function Options({ fields, values, errors, set }: OptionsProps) {
  const integrator = values['integrator'] ?? ''
  const applying = fields.filter((field) => isFor(field, integrator))
  const main = applying.filter(({ name }) => MAIN_FIELDS.includes(name))
  const more = applying.filter(({ name }) => !MAIN_FIELDS.includes(name))
  const given = more.filter(({ name }) => values[name] || errors[name]).length
  const show = (field: Field) => (
    <Control
      key={field.name}
      field={field}
      value={values[field.name] ?? ''}
      error={errors[field.name] ?? ''}
      set={set}
    />
  )
  return (
    <>
      <Card title="What, and until when">
        <div class="options-grid">{main.map(show)}</div>
      </Card>
      <details class="card" open={given > 0}>
        <summary>
          All other options ({more.length}
          {given > 0 ? `, ${given} set` : ''})
        </summary>
        <div class="options-grid">{more.map(show)}</div>
      </details>
    </>
  )
}

interface ControlProps {
  field: Field
  value: string
  error: string
  set: (name: string, value: string) => void
}

function Control({ field, value, error, set }: ControlProps) {
  const id = `option-${field.name}`
  const shared = {
    id,
    'aria-describedby': `${id}-text`,
    'aria-invalid': error !== '',
  }
  const change = (event: { currentTarget: { value: string } }) => {
    set(field.name, event.currentTarget.value)
  }
  return (
    <div class={`option ${value === '' ? '' : 'given'}`}>
      <label for={id}>{titleOf(field.name)}</label>
      {field.kind === 'choice' || field.kind === 'switch' ? (
        <select {...shared} value={value} onChange={change}>
          <option value="">default</option>
          {(field.kind === 'switch' ? ['true'] : field.choices).map((word) => (
            <option key={word} value={word}>
              {field.kind === 'switch' ? 'yes' : word}
            </option>
          ))}
        </select>
      ) : field.kind === 'pairs' ? (
        <textarea {...shared} rows={2} value={value} placeholder="name=value" onInput={change} />
      ) : (
        <input
          {...shared}
          value={value}
          placeholder={field.kind === 'list' ? field.choices.join(',') : 'default'}
          inputMode={field.kind === 'number' ? 'decimal' : 'text'}
          onInput={change}
        />
      )}
      <small id={`${id}-text`}>
        {field.text}
        {field.integrators.length > 0 && ` (${field.integrators.join(', ')})`}
      </small>
      {error !== '' && <small class="bad">{error}</small>}
    </div>
  )
}

function titleOf(name: string): string {
  const [word = '', ...rest] = name.replace(/^stop\./, 'stop: ').replaceAll('_', ' ')
  return word.toUpperCase() + rest.join('')
}
