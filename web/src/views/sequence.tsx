// A sequence as a strip of its frames, each as far as it is.

import { imagePath } from '../gateway'
import type { Frame } from '../model/sequence'
import { framesOf, summaryOf } from '../model/sequence'
import { formatRoute } from '../model/route'
import type { State } from '../state'
import { Bar, Card, JobBadge } from './parts'

export function SequencePage({ state, id }: { state: State; id: string }) {
  const frames = framesOf(state.farm, id)
  const first = frames[0]
  return (
    <Card title={first === undefined ? id : `${nameOf(first)}: ${summaryOf(frames)}`}>
      {first === undefined ? (
        <p class="empty">
          {state.listed ? `No frame of ${id} is among the newest jobs.` : 'Reading the list.'}
        </p>
      ) : (
        <ol class="strip" aria-label={`Frames of ${id}`}>
          {frames.map((frame) => (
            <FrameTile key={frame.job.id} frame={frame} />
          ))}
        </ol>
      )}
    </Card>
  )
}

/** The name of the whole: that of a frame without its number. */
const nameOf = ({ job, number }: Frame) => job.name.replace(new RegExp(` frame ${number}$`), '')

function FrameTile({ frame: { job, number } }: { frame: Frame }) {
  const picture = imagePath(job.id, 'png', `?size=256&film=${job.film ?? ''}`)
  return (
    <li>
      <a href={formatRoute({ page: 'job', id: job.id })}>
        {job.film !== null && job.rounds > 0 ? (
          <img src={picture} alt={`Frame ${number}`} width="160" loading="lazy" />
        ) : (
          <span class="blank">Frame {number}</span>
        )}
      </a>
      <Bar value={job.percent} label={`${job.percent} %`} />
      <span class="caption" title={job.note}>
        {number} <JobBadge job={job} />
      </span>
    </li>
  )
}
