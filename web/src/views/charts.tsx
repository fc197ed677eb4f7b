// Charts: a component around uPlot, which is told what to draw.

import { useEffect, useRef } from 'preact/hooks'
import uPlot from 'uplot'
import 'uplot/dist/uPlot.min.css'

import type { Axis } from '../model/convergence'
import { duration, metric, short } from '../model/format'
import { save } from './parts'

// The library declares its scales' kinds as an ambient const enum, which has no value to name.
// eslint-disable-next-line @typescript-eslint/no-unsafe-enum-assignment
const LOGARITHMIC = 3 as uPlot.Scale.Distr

export interface Curve {
  label: string
  /** Custom property of the style sheet that holds the color. */
  color: string
  values: (number | null)[]
  dash?: number[]
  points?: boolean
}

export interface ChartData {
  axis: Axis
  x: number[]
  curves: Curve[]
  /** Between which curves a band lies; they are drawn before the others. */
  band?: { low: (number | null)[]; high: (number | null)[] }
  logarithmic: boolean
}

interface ChartProps {
  data: ChartData
  /** For those who cannot see it, and the file's name. */
  label: string
  height: number
}

const AXES: Record<Axis, (value: number) => string> = {
  mutations: metric,
  wallSeconds: duration,
  cpuSeconds: duration,
}

function color(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim()
}

const shown = (_: uPlot, x: number | null) => (x === null ? '–' : short(x))

/** The value of the first curve, which the band is of, with the band's. */
function shownWithin(plot: uPlot, x: number | null, _: number, at: number | null): string {
  if (x === null || at === null) return '–'
  const [, high, low] = plot.data
  const [from, to] = [low?.[at], high?.[at]]
  return from == null || to == null ? short(x) : `${short(x)} (${short(from)} to ${short(to)})`
}

function seriesOf(curve: Curve, within: boolean): uPlot.Series {
  const { label, color: name, dash = [], points = false } = curve
  const stroke = color(name)
  return {
    label,
    stroke,
    width: 1.5,
    value: within ? shownWithin : shown,
    dash,
    spanGaps: true,
    points: { show: points, size: 5, fill: stroke },
  }
}

/** A side of the band. */
const edge = (): uPlot.Series => ({
  class: 'edge',
  stroke: 'transparent',
  points: { show: false },
})

const tick = (value: number) => (value < 0.001 ? value.toExponential(0) : metric(value))

/** The axis ends beside the data, not at the next power of ten; it begins where a line can be. */
function beside(_: uPlot, low: number | null, high: number | null): uPlot.Range.MinMax {
  if (low === null || high === null) return [1, 10]
  const decade = 10 ** Math.floor(Math.log10(low))
  return [decade * Math.floor(low / decade), high * 1.1]
}

function axisOf(label: (value: number) => string, size: number): uPlot.Axis {
  return {
    stroke: color('--muted'),
    grid: { stroke: color('--line'), width: 1 },
    ticks: { stroke: color('--line'), width: 1 },
    // uPlot passes null for ticks of a logarithmic axis that it wants without a label.
    values: (_, splits) =>
      splits.map((value) => ((value as number | null) === null ? '' : label(value))),
    size,
    font: '11px system-ui, sans-serif',
  }
}

function optionsOf(data: ChartData, width: number, height: number): uPlot.Options {
  const label = AXES[data.axis]
  const y = data.logarithmic ? { distr: LOGARITHMIC } : {}
  return {
    width,
    height,
    scales: { x: { time: false, distr: LOGARITHMIC, range: beside }, y },
    cursor: { drag: { x: false, y: false } },
    axes: [axisOf(label, 30), axisOf(data.logarithmic ? tick : short, 52)],
    series: [
      { label: 'at', value: (_, x: number | null) => (x === null ? '–' : label(x)) },
      ...(data.band ? [edge(), edge()] : []),
      ...data.curves.map((curve, i) => seriesOf(curve, data.band !== undefined && i === 0)),
    ],
    bands: data.band ? [{ series: [1, 2], fill: color('--band') }] : [],
  }
}

function alignedOf({ x, band, curves }: ChartData): uPlot.AlignedData {
  const edges = band ? [band.high, band.low] : []
  return [x, ...edges, ...curves.map(({ values }) => values)]
}

/** What must not change for new values to be put into a chart that is there. */
const shapeOf = (data: ChartData) =>
  JSON.stringify([data.axis, data.logarithmic, data.band !== undefined]) +
  data.curves.map(({ label, color: name }) => `${label}|${name}`).join()

export function Chart({ data, label, height }: ChartProps) {
  const parent = useRef<HTMLDivElement>(null)
  const plot = useRef<uPlot | null>(null)
  const latest = useRef(data)
  latest.current = data
  useEffect(() => {
    const element = parent.current
    if (element === null) return
    const build = () => {
      plot.current?.destroy()
      const options = optionsOf(latest.current, element.clientWidth, height)
      plot.current = new uPlot(options, alignedOf(latest.current), element)
    }
    build()
    const resized = new ResizeObserver(() => {
      plot.current?.setSize({ width: element.clientWidth, height })
    })
    resized.observe(element)
    const dark = matchMedia('(prefers-color-scheme: dark)')
    dark.addEventListener('change', build)
    return () => {
      resized.disconnect()
      dark.removeEventListener('change', build)
      plot.current?.destroy()
      plot.current = null
    }
  }, [shapeOf(data), height])
  useEffect(() => {
    plot.current?.setData(alignedOf(data))
  }, [data])
  return (
    <div ref={parent} class="chart" role="img" aria-label={label} data-points={data.x.length} />
  )
}

/** Saves a chart that is on the page as a picture, on the page's background. */
export function saveChart(section: Element | null, name: string): void {
  const drawn = section?.querySelector('canvas')
  if (!drawn) return
  const canvas = document.createElement('canvas')
  canvas.width = drawn.width
  canvas.height = drawn.height
  const context = canvas.getContext('2d')
  if (context === null) return
  context.fillStyle = color('--surface')
  context.fillRect(0, 0, canvas.width, canvas.height)
  context.drawImage(drawn, 0, 0)
  canvas.toBlob((blob) => {
    if (blob !== null) save(blob, name)
  })
}
