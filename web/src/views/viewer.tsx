// The image: developed here from its floats, with a pixel's values under the cursor, beside or over
// another one.

import { useEffect, useLayoutEffect, useMemo, useRef, useState } from 'preact/hooks'

import { short } from '../model/format'
import type { Pixels, Pyramid } from '../image/pixels'
import { at, differenceOf, luminance, meanOf, noiseOf, pyramidOf } from '../image/pixels'
import type { Curve, Placement, Screen } from '../image/tone'
import { autoExposure, drawTo, FALSE_STOPS, fit, PALETTE, zoom } from '../image/tone'
import { Select } from './parts'

export type Mode = 'image' | 'slider' | 'beside' | 'difference' | 'noise'

export interface Other {
  label: string
  pixels: Pixels
}

interface ViewerProps {
  image: Pixels
  /** The round that image shows. */
  round: number
  other: Other | null
  /** Variance of each pixel's mean, once it was asked for. */
  variance: Pixels | null
  mode: Mode
  setMode: (mode: Mode) => void
  /** What the reader chooses the other image with. */
  children: preact.ComponentChildren
}

const MODES = [
  ['image', 'Image'],
  ['slider', 'Slider'],
  ['beside', 'Side by side'],
  ['difference', 'Difference'],
  ['noise', 'Noise'],
] as const

const CURVES = [
  ['srgb', 'sRGB'],
  ['aces', 'ACES'],
  ['false', 'False color'],
] as const

interface Point {
  x: number
  y: number
}

/** What is drawn: up to two images, and how much of the width the first has. */
interface Scene {
  first: Pyramid
  second: Pyramid | null
  split: number
  beside: boolean
  curve: Curve
  exposure: number
  /** View, tone and round, as the canvas tells them once it shows them. */
  name: string
}

export function Viewer(props: ViewerProps) {
  const { image, round, other, variance, mode, setMode } = props
  const [curve, setCurve] = useState<Curve>('srgb')
  const [manual, setManual] = useState<number | null>(null)
  const [split, setSplit] = useState(0.5)
  const [place, setPlace] = useState<Placement | null>(null)
  const [cursor, setCursor] = useState<Point | null>(null)
  const derived = useMemo(
    () => derive(image, other, variance, mode),
    [image, other, variance, mode],
  )
  const first = useMemo(() => pyramidOf(derived.pixels), [derived.pixels])
  const second = useMemo(() => (other === null ? null : pyramidOf(other.pixels)), [other])
  const measured = derived.kind !== null
  const exposure = manual ?? (measured ? 0 : autoExposure(image))
  const compared = mode === 'slider' || mode === 'beside'
  const shownCurve = measured ? 'false' : curve
  const shownMode = measured || (compared && second !== null) ? mode : 'image'
  const scene: Scene = {
    name: `${shownMode} ${shownCurve} ${round}`,
    first,
    second: compared ? second : null,
    split: mode === 'beside' ? 0.5 : split,
    beside: mode === 'beside',
    curve: shownCurve,
    exposure: measured ? (manual ?? 0) + MEASURED_STOPS : exposure,
  }
  return (
    <div class="viewer">
      <div class="viewer-tools">
        <Select label="View" value={mode} options={MODES} onChange={setMode} />
        {props.children}
        {!measured && <Select label="Tone" value={curve} options={CURVES} onChange={setCurve} />}
        <Exposure value={exposure} automatic={manual === null} set={setManual} />
        <button
          type="button"
          onClick={() => {
            setPlace(null)
          }}
        >
          Fit
        </button>
      </div>
      <Screen2D
        scene={scene}
        place={place}
        setPlace={setPlace}
        cursor={cursor}
        setCursor={setCursor}
        setSplit={mode === 'slider' && second !== null ? setSplit : null}
      />
      {scene.curve === 'false' && (
        <Legend kind={derived.kind} exposure={scene.exposure} mean={meanOf(derived.pixels)} />
      )}
      <Readout image={image} other={other} derived={derived} cursor={cursor} note={derived.note} />
    </div>
  )
}

interface Derived {
  pixels: Pixels
  /** Name of what the values measure; null: they are the image. */
  kind: string | null
  note: string
}

/** A value of 0.18 is in the middle of the palette; measured ones are best seen around 0.01. */
const MEASURED_STOPS = 3

function derive(image: Pixels, other: Other | null, variance: Pixels | null, mode: Mode): Derived {
  const plain = (note: string) => ({ pixels: image, kind: null, note })
  if (mode === 'image') return plain('')
  try {
    if (mode === 'noise') {
      return variance === null
        ? plain('Reading the variance.')
        : { pixels: noiseOf(image, variance), kind: 'relative standard error', note: '' }
    }
    if (other === null) return plain('Choose what to compare with.')
    if (mode === 'difference') {
      const pixels = differenceOf(image, other.pixels)
      return { pixels, kind: 'relative squared error', note: '' }
    }
    return plain('')
  } catch (error) {
    return plain(error instanceof Error ? error.message : String(error))
  }
}

interface ExposureProps {
  value: number
  automatic: boolean
  set: (value: number | null) => void
}

function Exposure({ value, automatic, set }: ExposureProps) {
  return (
    <span class="exposure">
      <label>
        Exposure{' '}
        <input
          type="range"
          min="-12"
          max="12"
          step="0.25"
          value={value}
          onInput={(event) => {
            set(event.currentTarget.valueAsNumber)
          }}
        />
      </label>
      <output>{value.toFixed(1)}</output>
      <label>
        <input
          type="checkbox"
          checked={automatic}
          onChange={(event) => {
            set(event.currentTarget.checked ? null : value)
          }}
        />{' '}
        auto
      </label>
    </span>
  )
}

interface ScreenProps {
  scene: Scene
  place: Placement | null
  setPlace: (place: Placement | null) => void
  cursor: Point | null
  setCursor: (cursor: Point | null) => void
  setSplit: ((split: number) => void) | null
}

const STEP = 1.25

/** The canvas, and what mouse, touch and keys do to it. */
function Screen2D(props: ScreenProps) {
  const { scene, setPlace, setCursor, setSplit } = props
  const canvas = useRef<HTMLCanvasElement>(null)
  const [size, setSize] = useState({ width: 0, height: 0 })
  const drag = useRef<Point | null>(null)
  const [image] = scene.first
  const half = scene.beside && scene.second !== null
  const place = props.place ?? fit(image, half ? size.width / 2 : size.width, size.height)
  useEffect(() => {
    const element = canvas.current
    if (element === null) return
    const measure = () => {
      const ratio = Math.min(2, window.devicePixelRatio || 1)
      const [width, height] = [element.clientWidth, element.clientHeight]
      setSize({ width: Math.round(width * ratio), height: Math.round(height * ratio) })
    }
    const resized = new ResizeObserver(measure)
    resized.observe(element)
    return () => {
      resized.disconnect()
    }
  }, [])
  useLayoutEffect(() => {
    // What is on the canvas is of before this change, until it is painted again.
    canvas.current?.removeAttribute('data-drawn')
  })
  useEffect(() => {
    const frame = requestAnimationFrame(() => {
      if (canvas.current !== null) paint(canvas.current, size, scene, place)
    })
    return () => {
      cancelAnimationFrame(frame)
    }
  })
  const toCanvas = (event: MouseEvent): Point => {
    const box = canvas.current?.getBoundingClientRect()
    if (!box) return { x: 0, y: 0 }
    return {
      x: ((event.clientX - box.left) / box.width) * size.width,
      y: ((event.clientY - box.top) / box.height) * size.height,
    }
  }
  const toPixel = ({ x, y }: Point): Point => ({
    x: Math.floor(
      ((half && x >= size.width / 2 ? x - size.width / 2 : x) - place.left) / place.scale,
    ),
    y: Math.floor((y - place.top) / place.scale),
  })
  const onPointerMove = (event: PointerEvent) => {
    const here = toCanvas(event)
    setCursor(toPixel(here))
    const before = drag.current
    if (before === null) return
    if (setSplit !== null && !event.shiftKey) {
      setSplit(Math.min(1, Math.max(0, here.x / size.width)))
    } else {
      drag.current = here
      setPlace({
        ...place,
        left: place.left + here.x - before.x,
        top: place.top + here.y - before.y,
      })
    }
  }
  const onKeyDown = (event: KeyboardEvent) => {
    const middle = { x: size.width / 2, y: size.height / 2 }
    const to = keyed(event.key, props.cursor ?? toPixel(middle))
    if (event.key === '+' || event.key === '=') setPlace(zoom(place, STEP, middle.x, middle.y))
    else if (event.key === '-') setPlace(zoom(place, 1 / STEP, middle.x, middle.y))
    else if (event.key === '0') setPlace(null)
    else if (to !== null) setCursor(to)
    else return
    event.preventDefault()
  }
  useWheel(canvas, (event) => {
    const here = toCanvas(event)
    const x = half && here.x >= size.width / 2 ? here.x - size.width / 2 : here.x
    setPlace(zoom(place, event.deltaY < 0 ? STEP : 1 / STEP, x, here.y))
  })
  return (
    <canvas
      ref={canvas}
      id="image"
      width={size.width}
      height={size.height}
      tabIndex={0}
      role="img"
      aria-label="The image so far. Plus and minus zoom, 0 fits, arrows move the cursor."
      style={{ aspectRatio: `${image.width} / ${image.height}` }}
      onPointerDown={(event) => {
        drag.current = toCanvas(event)
        event.currentTarget.setPointerCapture(event.pointerId)
      }}
      onPointerMove={onPointerMove}
      onPointerUp={() => {
        drag.current = null
      }}
      onPointerLeave={() => {
        if (drag.current === null) setCursor(null)
      }}
      onKeyDown={onKeyDown}
    />
  )
}

/** Listens to the wheel in a way that lets the page stay where it is. */
function useWheel(
  canvas: { current: HTMLCanvasElement | null },
  turned: (event: WheelEvent) => void,
) {
  const latest = useRef(turned)
  latest.current = turned
  useEffect(() => {
    const element = canvas.current
    const listen = (event: WheelEvent) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== element) return
      event.preventDefault()
      latest.current(event)
    }
    element?.addEventListener('wheel', listen, { passive: false })
    return () => {
      element?.removeEventListener('wheel', listen)
    }
  }, [])
}

function keyed(key: string, { x, y }: Point): Point | null {
  switch (key) {
    case 'ArrowLeft':
      return { x: x - 1, y }
    case 'ArrowRight':
      return { x: x + 1, y }
    case 'ArrowUp':
      return { x, y: y - 1 }
    case 'ArrowDown':
      return { x, y: y + 1 }
    default:
      return null
  }
}

function paint(
  canvas: HTMLCanvasElement,
  { width, height }: { width: number; height: number },
  scene: Scene,
  place: Placement,
): void {
  const context = canvas.getContext('2d')
  if (context === null || width === 0 || height === 0) return
  const data = context.createImageData(width, height)
  const screen: Screen = { width, height, rgba: data.data }
  const tone = { curve: scene.curve, exposure: scene.exposure }
  const middle = Math.round(width * scene.split)
  if (scene.second === null) {
    drawTo(screen, scene.first, place, tone)
  } else {
    drawTo(screen, scene.first, place, tone, 0, middle)
    const shift = scene.beside ? { ...place, left: place.left + middle } : place
    drawTo(screen, scene.second, shift, tone, middle, width)
  }
  context.putImageData(data, 0, 0)
  if (scene.second !== null) {
    context.fillStyle = '#fff'
    context.fillRect(middle - 1, 0, 2, height)
  }
  canvas.dataset.drawn = scene.name
}

interface LegendProps {
  kind: string | null
  exposure: number
  mean: number
}

function Legend({ kind, exposure, mean }: LegendProps) {
  const canvas = useRef<HTMLCanvasElement>(null)
  useEffect(() => {
    const context = canvas.current?.getContext('2d')
    PALETTE.forEach(([r, g, b], x) => {
      if (!context) return
      context.fillStyle = `rgb(${r} ${g} ${b})`
      context.fillRect(x, 0, 1, 1)
    })
  }, [])
  const value = (stops: number) => short(0.18 * 2 ** (stops - exposure))
  return (
    <div class="legend">
      <span>{value(-FALSE_STOPS / 2)}</span>
      <canvas ref={canvas} width={PALETTE.length} height={1} role="img" aria-label="Palette" />
      <span>{value(FALSE_STOPS / 2)}</span>
      <span>{kind === null ? 'luminance' : `${kind}, mean ${short(mean)}`}</span>
    </div>
  )
}

interface ReadoutProps {
  image: Pixels
  other: Other | null
  derived: Derived
  cursor: Point | null
  note: string
}

function Readout({ image, other, derived, cursor, note }: ReadoutProps) {
  const here = cursor && at(image, cursor.x, cursor.y)
  if (!here) {
    const help = `${image.width} × ${image.height} pixels. Click, then turn the wheel to zoom; drag to move.`
    return <p class="readout">{note || help}</p>
  }
  const there = other && at(other.pixels, cursor.x, cursor.y)
  const measured = derived.kind === null ? null : at(derived.pixels, cursor.x, cursor.y)
  return (
    <p class="readout">
      <b>
        {cursor.x}, {cursor.y}
      </b>{' '}
      {here.map(digits).join(' ')} <span class="muted">luminance</span> {digits(luminance(here))}
      {there && (
        <>
          {' '}
          <span class="muted">{other.label}</span> {there.map(digits).join(' ')}
        </>
      )}
      {measured && (
        <>
          {' '}
          <span class="muted">{derived.kind}</span> {digits(measured[0])}
        </>
      )}
    </p>
  )
}

const digits = (x: number) => x.toPrecision(4)
