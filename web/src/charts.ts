// The two charts: relative error over mutations (both logarithmic), b over mutations.

import uPlot from 'uplot'
import 'uplot/dist/uPlot.min.css'

import type { Point } from './model'
import { errorColumns, metric, short } from './model'

const HEIGHT = 220
// The library declares its scales' kinds as an ambient const enum, which has no value to name.
// eslint-disable-next-line @typescript-eslint/no-unsafe-enum-assignment
const LOGARITHMIC = 3 as uPlot.Scale.Distr

/** A chart that is redrawn with new points, and rebuilt when colors or width change. */
export class Chart {
  private plot: uPlot | null = null
  private data: uPlot.AlignedData = [[]]

  constructor(
    private readonly parent: HTMLElement,
    private readonly options: (width: number) => uPlot.Options,
  ) {
    new ResizeObserver(() => {
      this.plot?.setSize({ width: this.parent.clientWidth, height: HEIGHT })
    }).observe(parent)
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
      this.rebuild()
    })
  }

  show(data: uPlot.AlignedData): void {
    this.data = data
    if (this.plot === null) this.rebuild()
    else this.plot.setData(data)
  }

  private rebuild(): void {
    this.plot?.destroy()
    this.plot = new uPlot(this.options(this.parent.clientWidth), this.data, this.parent)
  }
}

function color(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim()
}

function axis(label: (value: number) => string): uPlot.Axis {
  return {
    stroke: color('--muted'),
    grid: { stroke: color('--line'), width: 1 },
    ticks: { stroke: color('--line'), width: 1 },
    // uPlot passes null for ticks of a logarithmic axis that it wants without a label.
    values: (_, splits) =>
      splits.map((value) => ((value as number | null) === null ? '' : label(value))),
    size: 60,
  }
}

function mutationsAxis(): uPlot.Axis {
  return { ...axis((value) => metric(value)), size: 34 }
}

const value = (_: uPlot, x: number | null) => (x === null ? '–' : short(x))

function edge(label: string): uPlot.Series {
  return { label, stroke: 'transparent', value, points: { show: false } }
}

function line(label: string, stroke: string, dash?: number[]): uPlot.Series {
  return {
    label,
    stroke,
    width: 1.5,
    value,
    points: { show: dash === undefined },
    dash: dash ?? [],
  }
}

const shared = (width: number) => ({
  width,
  height: HEIGHT,
  cursor: { drag: { x: false, y: false } },
})

export function errorOptions(width: number): uPlot.Options {
  return {
    ...shared(width),
    scales: { x: { time: false, distr: LOGARITHMIC }, y: { distr: LOGARITHMIC } },
    axes: [mutationsAxis(), axis((y) => y.toExponential(0))],
    series: [
      { label: 'mutations', value: (_, x: number | null) => (x === null ? '–' : metric(x)) },
      edge('upper'),
      edge('lower'),
      line('relMSE', color('--accent')),
      line('1/N', color('--muted'), [4, 4]),
      line('target', color('--target'), [8, 4]),
    ],
    bands: [{ series: [1, 2], fill: color('--band') }],
  }
}

export function errorData(points: readonly Point[], target: number | null): uPlot.AlignedData {
  const c = errorColumns(points, target)
  return [c.mutations, c.high, c.low, c.error, c.guide, c.target]
}

export function bOptions(width: number): uPlot.Options {
  return {
    ...shared(width),
    scales: { x: { time: false, distr: LOGARITHMIC }, y: {} },
    axes: [mutationsAxis(), axis(short)],
    series: [
      { label: 'mutations', value: (_, x: number | null) => (x === null ? '–' : metric(x)) },
      edge('upper'),
      edge('lower'),
      line('b', color('--accent')),
    ],
    bands: [{ series: [1, 2], fill: color('--band') }],
  }
}

export function bData(points: readonly Point[]): uPlot.AlignedData {
  const usable = points.filter((point) => point.mutations > 0 && point.b.value > 0)
  return [
    usable.map((point) => point.mutations),
    usable.map((point) => point.b.high),
    usable.map((point) => point.b.low),
    usable.map((point) => point.b.value),
  ]
}
