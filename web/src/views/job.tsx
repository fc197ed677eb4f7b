// One job: its image, how it converges, and what is known about why.

import { useEffect, useState } from 'preact/hooks'

import { imagePath } from '../gateway'
import type { Picture, Pixels } from '../image/pixels'
import { duration, metric, short } from '../model/format'
import { PILOT_ROUNDS, timeToTarget } from '../model/convergence'
import type { Job } from '../model/job'
import { mayChange } from '../model/job'
import { formatRoute } from '../model/route'
import type { Actions, JobPage, State } from '../state'
import { Anomalies, Chains, Facts, Groups, Log, PlanCard, TimelineCard } from './details'
import { ErrorCard, NormalizationCard } from './curves'
import { Bar, Card, JobBadge, Select } from './parts'
import type { Mode, Other } from './viewer'
import { Viewer } from './viewer'

export function JobView({ state, actions }: { state: State; actions: Actions }) {
  const { page } = state
  const job = page?.job
  if (!page || !job) return <p class="empty">Reading the job.</p>
  return (
    <article class="job">
      <JobHead job={job} page={page} state={state} actions={actions} />
      <div class="job-columns">
        <div>
          <ImageCard key={job.id} job={job} page={page} state={state} actions={actions} />
          <Facts job={job} />
        </div>
        <div>
          <ErrorCard job={job} points={page.points} />
          <NormalizationCard job={job} points={page.points} />
          <Chains job={job} points={page.points} />
        </div>
      </div>
      <div class="job-details">
        <TimelineCard job={job} events={page.events} />
        <Groups title="By path length" groups={job.lengths} />
        <Groups title="By technique" groups={job.techniques} />
        <Anomalies job={job} events={page.events} tokens={state.session?.tokens === true} />
        {page.plan !== null && <PlanCard plan={page.plan} />}
        <Log events={page.events} />
      </div>
    </article>
  )
}

interface Props {
  job: Job
  page: JobPage
  state: State
  actions: Actions
}

function JobHead({ job, page, state, actions }: Props) {
  const estimate = job.target === null || job.ended ? null : timeToTarget(page.points, job.target)
  return (
    <header class="job-head">
      <h1>{job.name}</h1>
      <JobBadge job={job} />
      <span class="muted id">{job.id}</span>
      {page.deleted ? (
        <p id="deleted" class="note bad" role="status">
          This job was deleted. What this page had of it is below.
        </p>
      ) : (
        <JobButtons job={job} state={state} actions={actions} />
      )}
      <div class="job-progress">
        <Bar value={job.percent} label={`${job.percent} %`} />
        <span id="progress-text">
          {[
            `${job.percent} %`,
            job.phase,
            job.rate > 0 ? `${metric(job.rate)} mutations/s` : '',
            job.etaSeconds === null ? '' : `${duration(job.etaSeconds)} left`,
          ]
            .filter(Boolean)
            .join(' · ')}
        </span>
        {job.target !== null && !job.ended && (
          <span id="estimate" title="If the error goes on to fall as 1/N, at the pace so far">
            {estimate === null
              ? `time to the target ${short(job.target)}: told after round ${PILOT_ROUNDS}`
              : `target ${short(job.target)} in about ${duration(estimate.value)} ` +
                `(${duration(estimate.low)} to ${duration(estimate.high)})`}
          </span>
        )}
      </div>
      {job.note !== '' && <p class={`note ${job.failed ? 'bad' : ''}`}>{job.note}</p>}
    </header>
  )
}

type HeadProps = Omit<Props, 'page'>

function JobButtons({ job, state, actions }: HeadProps) {
  const [refining, setRefining] = useState(false)
  const may = mayChange(state.session, job.user)
  const button = (
    action: 'pause' | 'resume' | 'finish' | 'cancel',
    text: string,
    title: string,
  ) => (
    <button
      type="button"
      id={action}
      title={title}
      disabled={!may || job.ended}
      class={action === 'cancel' ? 'danger' : ''}
      onClick={() => {
        actions.act(job.id, action)
      }}
    >
      {text}
    </button>
  )
  return (
    <div class="buttons">
      {job.paused
        ? button('resume', 'Resume', 'Go on handing out work')
        : button('pause', 'Pause', 'Stop handing out work')}
      {button('finish', 'Finish now', 'Make the round under way the last')}
      {button('cancel', 'Cancel', 'End the job; its image so far stays')}
      {job.ended && state.canRefine && job.state !== 'failed' && (
        <button
          type="button"
          disabled={!may}
          aria-expanded={refining}
          onClick={() => {
            setRefining(!refining)
          }}
        >
          Refine
        </button>
      )}
      <a class="button" href={formatRoute({ page: 'submit', clone: job.id })}>
        Clone
      </a>
      <a class="button" href={formatRoute({ page: 'compare', ids: [...state.picked, job.id] })}>
        Compare
      </a>
      {!job.ended && (
        <Priority
          value={job.priority}
          disabled={!may}
          change={(priority) => {
            actions.changePriority(job.id, priority)
          }}
        />
      )}
      {refining && job.ended && (
        <RefineForm
          job={job}
          refine={(stop) => {
            setRefining(false)
            actions.refine(job.id, stop)
          }}
        />
      )}
    </div>
  )
}

interface PriorityProps {
  value: number
  disabled: boolean
  change: (priority: number) => void
}

/** News of the job must not undo what is being typed. */
function Priority({ value, disabled, change }: PriorityProps) {
  const [draft, setDraft] = useState<string | null>(null)
  return (
    <label class="select">
      <span>Priority</span>
      <input
        type="number"
        min="-100"
        max="100"
        disabled={disabled}
        value={draft ?? value}
        onInput={(event) => {
          setDraft(event.currentTarget.value)
        }}
        onChange={(event) => {
          change(event.currentTarget.valueAsNumber)
          setDraft(null)
        }}
      />
    </label>
  )
}

const RULES = [
  ['target_error', 'relative error'],
  ['time_seconds', 'seconds'],
  ['mutations_per_pixel', 'mutations per pixel'],
  ['samples_per_pixel', 'samples per pixel'],
  ['rounds', 'rounds'],
] as const

interface RefineProps {
  job: Job
  refine: (stop: Record<string, unknown>) => void
}

function RefineForm({ job, refine }: RefineProps) {
  const [rule, setRule] = useState<(typeof RULES)[number][0]>('target_error')
  const [value, setValue] = useState(String((job.error?.value ?? 0.01) / 2))
  return (
    <form
      class="refine"
      onSubmit={(event) => {
        event.preventDefault()
        refine({ [rule]: Number(value) })
      }}
    >
      <Select label="Go on until" value={rule} options={RULES} onChange={setRule} />
      <input
        aria-label="Value of the rule"
        inputMode="decimal"
        value={value}
        onInput={(event) => {
          setValue(event.currentTarget.value)
        }}
      />
      <button type="submit" class="primary">
        Go on
      </button>
    </form>
  )
}

function ImageCard({ job, page, state, actions }: Props) {
  const [mode, setMode] = useState<Mode>('image')
  const [other, setOther] = useState<Other | null>(null)
  const [noise, setNoise] = useState<Noise | null>(null)
  const [problem, setProblem] = useState('')
  const { image } = page
  useEffect(() => {
    if (mode !== 'noise' || image === null) return
    let current = true
    actions.loadImage(job.id, 'variance').then(
      (variance) => {
        // Of another round than the image, it waits for that.
        if (current && variance?.film === image.film) setNoise({ image, variance: variance.pixels })
      },
      () => {
        setProblem('The variance could not be read.')
      },
    )
    return () => {
      current = false
    }
  }, [mode, image])
  const tools = (
    <>
      <a id="exr" href={imagePath(job.id, 'exr')} download={`${job.id}.exr`}>
        EXR
      </a>
      <a href={imagePath(job.id, 'pfm')} download={`${job.id}.pfm`}>
        PFM
      </a>
      <a href={imagePath(job.id, 'png')} download={`${job.id}.png`}>
        PNG
      </a>
    </>
  )
  if (image === null) {
    return (
      <Card title="Image">
        <p class="empty">
          {job.rounds > 0
            ? 'Reading the image.'
            : 'The image appears with the first complete round.'}
        </p>
      </Card>
    )
  }
  const shown = mode === 'noise' ? (noise?.image ?? image) : image
  const against = mode === 'slider' || mode === 'beside' || mode === 'difference'
  return (
    <Card title={titleOf(shown)} tools={tools} class="image">
      <Viewer
        image={shown.pixels}
        round={shown.round}
        other={other}
        variance={noise?.variance ?? null}
        mode={mode}
        setMode={setMode}
      >
        {against && (
          <OtherPicker
            page={page}
            state={state}
            actions={actions}
            other={other}
            choose={setOther}
            fail={setProblem}
          />
        )}
      </Viewer>
      {problem !== '' && (
        <p class="problem" role="alert">
          {problem}
        </p>
      )}
    </Card>
  )
}

/** An image with the variance of the same round. */
interface Noise {
  image: Picture
  variance: Pixels
}

const titleOf = ({ round, mutations }: Picture) =>
  `Image after round ${round}${mutations > 0 ? `, ${metric(mutations)} mutations` : ''}`

interface PickerProps {
  page: JobPage
  state: State
  actions: Actions
  other: Other | null
  choose: (other: Other) => void
  fail: (problem: string) => void
}

/** Earlier rounds that the page has kept, other jobs, or a file. */
function OtherPicker({ page, state, actions, other, choose, fail }: PickerProps) {
  const [chosen, setChosen] = useState('')
  const rounds = [...page.rounds.keys()].filter((round) => round !== page.image?.round).reverse()
  const jobs = [...state.farm.jobs.values()].filter(({ id, rounds: n }) => id !== page.id && n > 0)
  const load = (label: string, pixels: Promise<Pixels | undefined>) => {
    fail('')
    pixels.then(
      (loaded) => {
        if (loaded !== undefined) choose({ label, pixels: loaded })
      },
      (error: unknown) => {
        fail(error instanceof Error ? error.message : String(error))
      },
    )
  }
  const pick = (key: string) => {
    setChosen(key)
    const kept = page.rounds.get(Number(key))
    const job = state.farm.jobs.get(key)
    if (kept !== undefined) choose({ label: `round ${key}`, pixels: kept })
    else if (job !== undefined) {
      load(
        job.name,
        actions.loadImage(job.id, 'color').then((picture) => picture?.pixels),
      )
    }
  }
  return (
    <>
      <Select
        label="With"
        value={chosen}
        options={[
          ['', other === null ? 'choose' : other.label],
          ...rounds.map((round) => [String(round), `round ${round}`] as const),
          ...jobs.map((job) => [job.id, `${job.name} (${job.id.slice(-5)})`] as const),
        ]}
        onChange={pick}
      />
      <label class="file">
        Reference file{' '}
        <input
          type="file"
          accept=".pfm,.png,.jpg,.jpeg,.webp"
          onChange={(event) => {
            const file = event.currentTarget.files?.[0]
            if (file === undefined) return
            setChosen('')
            load(file.name, actions.loadFile(file))
          }}
        />
      </label>
    </>
  )
}
