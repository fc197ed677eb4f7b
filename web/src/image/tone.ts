// From linear values to colors on a screen.

import type { Pixels, Pyramid } from './pixels'

export type Curve = 'srgb' | 'aces' | 'false'

export interface Tone {
  curve: Curve
  /** Stops. */
  exposure: number
}

/** Parameters of autoExposure, as those of the server's previews. */
const BRIGHT_QUANTILE = 0.95
const BRIGHT_TARGET = 0.8
const MAX_STOPS = 20
const BLACK = 1e-20
const SAMPLED = 1 << 16

/** The exposure that shows an image well: its 95th percentile becomes 0.8. */
export function autoExposure({ rgb }: Pixels): number {
  const luminances: number[] = []
  const step = 3 * Math.max(1, Math.floor(rgb.length / 3 / SAMPLED))
  for (let i = 0; i < rgb.length; i += step) {
    const y = luminanceAt(rgb, i)
    if (y > BLACK && Number.isFinite(y)) luminances.push(y)
  }
  const bright = luminances.sort((a, b) => a - b)[
    Math.floor(BRIGHT_QUANTILE * (luminances.length - 1))
  ]
  if (bright === undefined) return 0
  return Math.min(MAX_STOPS, Math.max(-MAX_STOPS, Math.log2(BRIGHT_TARGET / bright)))
}

const luminanceAt = (rgb: Float32Array, i: number) =>
  0.2126 * (rgb[i] ?? 0) + 0.7152 * (rgb[i + 1] ?? 0) + 0.0722 * (rgb[i + 2] ?? 0)

export function srgb(linear: number): number {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055
}

/** The curve of Narkowicz (2015), which follows ACES' reference rendering. */
export function aces(x: number): number {
  return (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
}

/** Codes by the upper bits of a float: exponent and nine bits of its fraction. */
const TABLE_SHIFT = 14
const INFINITE = 0x7f800000

export function toneTable({ curve, exposure }: Tone): Uint8Array {
  const table = new Uint8Array(1 << (31 - TABLE_SHIFT))
  const scale = 2 ** exposure
  const bits = new Uint32Array(1)
  const float = new Float32Array(bits.buffer)
  for (let i = 0; i < table.length; i++) {
    bits[0] = (i << TABLE_SHIFT) | (1 << (TABLE_SHIFT - 1)) // the middle of those it stands for
    const linear = (float[0] ?? 0) * scale
    const mapped = Math.min(1, curve === 'aces' ? aces(Math.min(linear, 1e6)) : linear)
    table[i] = Number.isNaN(mapped) ? 0 : Math.round(255 * srgb(mapped))
  }
  table[INFINITE >>> TABLE_SHIFT] = 255
  return table
}

/** Viridis at equal distances: dark to bright and readable without telling red from green. */
const VIRIDIS = [
  [68, 1, 84],
  [72, 36, 117],
  [65, 68, 135],
  [53, 95, 141],
  [42, 120, 142],
  [33, 145, 140],
  [34, 168, 132],
  [68, 191, 112],
  [122, 209, 81],
  [189, 223, 38],
  [253, 231, 37],
] as const

export const PALETTE: readonly (readonly [number, number, number])[] = Array.from(
  { length: 256 },
  (_, i) => {
    const position = (i / 255) * (VIRIDIS.length - 1)
    const low = VIRIDIS[Math.floor(position)] ?? VIRIDIS[0]
    const high = VIRIDIS[Math.ceil(position)] ?? low
    const t = position % 1
    const mix = (c: 0 | 1 | 2) => Math.round(low[c] + t * (high[c] - low[c]))
    return [mix(0), mix(1), mix(2)]
  },
)

/** Stops that false color spans: half of them above and below 0.18, as exposed. */
export const FALSE_STOPS = 16

/** Which color of the palette a luminance has; -1: none, it is black. */
export function falseIndex(luminance: number, exposure: number): number {
  if (!(luminance > 0)) return -1
  const stops = Math.log2(luminance / 0.18) + exposure + FALSE_STOPS / 2
  return Math.max(0, Math.min(255, Math.floor((stops / FALSE_STOPS) * 255)))
}

/** Where the image lies on the screen: its pixel (x, y) at scale * (x, y) + (left, top). */
export interface Placement {
  scale: number
  left: number
  top: number
}

export interface Screen {
  width: number
  height: number
  rgba: Uint8ClampedArray
}

/** The pixels of each column of the screen, as indices into a row; -1 outside. */
function columnsOf(screen: Screen, place: Placement, image: Pixels, full: Pixels): Int32Array {
  const ratio = image.width / full.width
  return Int32Array.from({ length: screen.width }, (_, x) => {
    const column = Math.floor(((x + 0.5 - place.left) / place.scale) * ratio)
    return column >= 0 && column < image.width ? 3 * column : -1
  })
}

/** Draws columns [from, to) of an image on the screen; what lies outside stays as it is. */
export function drawTo(
  screen: Screen,
  pyramid: Pyramid,
  place: Placement,
  tone: Tone,
  from = 0,
  to = screen.width,
): void {
  const [full] = pyramid
  const level = Math.max(0, Math.min(pyramid.length - 1, Math.floor(-Math.log2(place.scale) + 0.1)))
  const image = pyramid[level] ?? full
  const columns = columnsOf(screen, place, image, full)
  const put = tone.curve === 'false' ? falseWriter(image, tone) : tableWriter(image, tone)
  const ratio = image.height / full.height
  for (let y = 0; y < screen.height; y++) {
    const row = Math.floor(((y + 0.5 - place.top) / place.scale) * ratio)
    if (row < 0 || row >= image.height) continue
    const start = 3 * row * image.width
    for (let x = from; x < to; x++) {
      const column = columns[x] ?? -1
      if (column >= 0) put(screen.rgba, 4 * (y * screen.width + x), start + column)
    }
  }
}

type Writer = (rgba: Uint8ClampedArray, to: number, from: number) => void

function tableWriter({ rgb }: Pixels, tone: Tone): Writer {
  const table = toneTable(tone)
  const bits = new Uint32Array(rgb.buffer, rgb.byteOffset, rgb.length)
  return (rgba, to, from) => {
    // A set sign leads beyond the table: what is negative is black.
    rgba[to] = table[(bits[from] ?? 0) >>> TABLE_SHIFT] ?? 0
    rgba[to + 1] = table[(bits[from + 1] ?? 0) >>> TABLE_SHIFT] ?? 0
    rgba[to + 2] = table[(bits[from + 2] ?? 0) >>> TABLE_SHIFT] ?? 0
    rgba[to + 3] = 255
  }
}

function falseWriter({ rgb }: Pixels, { exposure }: Tone): Writer {
  return (rgba, to, from) => {
    const color = PALETTE[falseIndex(luminanceAt(rgb, from), exposure)]
    rgba[to] = color?.[0] ?? 0
    rgba[to + 1] = color?.[1] ?? 0
    rgba[to + 2] = color?.[2] ?? 0
    rgba[to + 3] = 255
  }
}

/** The placement that shows all of an image in the middle. */
export function fit(image: Pixels, width: number, height: number): Placement {
  const scale = Math.min(width / image.width, height / image.height)
  return {
    scale,
    left: (width - image.width * scale) / 2,
    top: (height - image.height * scale) / 2,
  }
}

/** Zooms by a factor about a point of the screen, which stays where it is. */
export function zoom(place: Placement, factor: number, x: number, y: number): Placement {
  const scale = Math.min(64, Math.max(1 / 64, place.scale * factor))
  const by = scale / place.scale
  return { scale, left: x - (x - place.left) * by, top: y - (y - place.top) * by }
}
