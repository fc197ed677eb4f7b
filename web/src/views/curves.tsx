// How a job converges: its error, and b.

import { useMemo, useState } from 'preact/hooks'

import type { Axis } from '../model/convergence'
import { bColumns, errorColumns, toCSV } from '../model/convergence'
import type { Job, Point } from '../model/job'
import { withInterval } from '../model/job'
import { Chart, saveChart } from './charts'
import { AXIS_NAMES } from './compare'
import { Card, save, Select } from './parts'

interface Props {
  job: Job
  points: Point[]
}

export function ErrorCard({ job, points }: Props) {
  const [axis, setAxis] = useState<Axis>('mutations')
  const data = useMemo(() => {
    const { x, error, low, high, guide, target } = errorColumns(points, axis, job.target)
    const curves = [
      { label: 'relMSE', color: '--accent', values: error, points: true },
      { label: '1/N', color: '--muted', values: guide, dash: [4, 4] },
    ]
    if (job.target !== null) {
      curves.push({ label: 'target', color: '--target', values: target, dash: [8, 4] })
    }
    return { axis, x, curves, band: { low, high }, logarithmic: true }
  }, [points, axis, job.target])
  return (
    <Card
      title={`Relative error${job.error === null ? '' : ` ${withInterval(job.error)}`}`}
      tools={
        <>
          <Select label="Against" value={axis} options={AXIS_NAMES} onChange={setAxis} />
          <button
            type="button"
            onClick={() => {
              save(new Blob([toCSV(points)], { type: 'text/csv' }), `${job.id}.csv`)
            }}
          >
            CSV
          </button>
          <button
            type="button"
            onClick={(event) => {
              saveChart(event.currentTarget.closest('.card'), `${job.id}-error.png`)
            }}
          >
            PNG
          </button>
        </>
      }
    >
      <Chart data={data} height={250} label="Relative error after each round, with its interval" />
    </Card>
  )
}

export function NormalizationCard({ job, points }: Props) {
  const data = useMemo(() => {
    const { x, b, low, high } = bColumns(points, 'mutations')
    const curves = [{ label: 'b', color: '--accent', values: b, points: true }]
    return { axis: 'mutations' as const, x, curves, band: { low, high }, logarithmic: false }
  }, [points])
  const last = points.at(-1)
  if (last === undefined || !(last.b.value > 0)) return null
  return (
    <Card
      title={`Normalization b ${withInterval(last.b)}`}
      tools={
        <button
          type="button"
          onClick={(event) => {
            saveChart(event.currentTarget.closest('.card'), `${job.id}-b.png`)
          }}
        >
          PNG
        </button>
      }
    >
      <Chart data={data} height={150} label="Normalization b after each round, with its interval" />
    </Card>
  )
}
