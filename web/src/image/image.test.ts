import { describe, expect, it } from 'vitest'

import type { Pixels } from './pixels'
import {
  at,
  differenceOf,
  fromSRGB,
  halve,
  keepRound,
  noiseOf,
  parsePFM,
  pyramidOf,
  toPicture,
} from './pixels'
import { aces, autoExposure, drawTo, falseIndex, fit, PALETTE, srgb, toneTable, zoom } from './tone'

function pfm(head: string, values: number[], little = true): ArrayBuffer {
  const buffer = new ArrayBuffer(head.length + 4 * values.length)
  new Uint8Array(buffer).set(new TextEncoder().encode(head))
  const view = new DataView(buffer, head.length)
  values.forEach((value, i) => {
    view.setFloat32(4 * i, value, little)
  })
  return buffer
}

const gray = (width: number, height: number, value: number): Pixels => ({
  width,
  height,
  rgb: new Float32Array(3 * width * height).fill(value),
})

describe('parsePFM', () => {
  it('puts the last row first', () => {
    const image = parsePFM(pfm('PF\n1 2\n-1.0\n', [1, 2, 3, 4, 5, 6]))
    expect(at(image, 0, 0)).toEqual([4, 5, 6])
    expect(at(image, 0, 1)).toEqual([1, 2, 3])
    expect(at(image, 0, 2)).toBeNull()
  })

  it('reads gray and big-endian ones', () => {
    expect(at(parsePFM(pfm('Pf 2 1 1.0\n', [7, 8], false)), 1, 0)).toEqual([8, 8, 8])
  })

  it('refuses what is none or cut off', () => {
    expect(() => parsePFM(pfm('P6\n1 1\n255\n', []))).toThrow('no portable float map')
    expect(() => parsePFM(pfm('PF\n2 2\n-1.0\n', [1, 2, 3]))).toThrow('2 × 2 is cut off')
  })
})

describe('tone', () => {
  const code = (value: number, exposure = 0) => {
    const screen = { width: 1, height: 1, rgba: new Uint8ClampedArray(4) }
    const place = { scale: 1, left: 0, top: 0 }
    drawTo(screen, pyramidOf(gray(1, 1, value)), place, { curve: 'srgb', exposure })
    return screen.rgba[0] ?? -1
  }

  it('is sRGB to within a code', () => {
    for (const value of [0.001, 0.02, 0.18, 0.5, 0.9, 1]) {
      expect(Math.abs(code(value) - 255 * srgb(value))).toBeLessThanOrEqual(1)
    }
    expect([code(0), code(-1), code(NaN), code(9)]).toEqual([0, 0, 0, 255])
    expect(code(0.25, 1)).toBe(code(0.5))
  })

  it('maps infinity to white and rises everywhere', () => {
    expect(code(Infinity)).toBe(255)
    for (const curve of ['srgb', 'aces'] as const) {
      const table = toneTable({ curve, exposure: 0 })
      const finite = table.subarray(0, 0x7f800000 >>> 14)
      expect(finite.every((value, i) => i === 0 || value >= (finite[i - 1] ?? 0))).toBe(true)
    }
  })

  it('follows the published points of the ACES fit', () => {
    expect(aces(0)).toBe(0)
    expect(aces(1)).toBeCloseTo(0.8038, 4)
  })

  it('shows the bright part of an image at 0.8', () => {
    expect(autoExposure(gray(4, 4, 0.2))).toBeCloseTo(2)
    expect(autoExposure(gray(4, 4, 0))).toBe(0)
  })

  it('has a palette that grows brighter', () => {
    const luminances = PALETTE.map(([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b)
    expect(luminances.every((y, i) => i === 0 || y >= (luminances[i - 1] ?? 0) - 0.5)).toBe(true)
    expect([falseIndex(0, 0), falseIndex(0.18, 0), falseIndex(1e9, 0)]).toEqual([-1, 127, 255])
  })
})

describe('placement', () => {
  it('fits an image in the middle', () => {
    expect(fit(gray(10, 10, 0), 40, 20)).toEqual({ scale: 2, left: 10, top: 0 })
  })

  it('zooms about a point, which stays', () => {
    const before = { scale: 1, left: 3, top: 4 }
    const after = zoom(before, 4, 10, 20)
    expect((10 - after.left) / after.scale).toBe((10 - before.left) / before.scale)
    expect((20 - after.top) / after.scale).toBe((20 - before.top) / before.scale)
    expect(zoom(before, 1e9, 0, 0).scale).toBe(64)
  })

  it('draws within its columns, and nothing outside of the image', () => {
    const screen = { width: 4, height: 1, rgba: new Uint8ClampedArray(16) }
    const tone = { curve: 'srgb', exposure: 0 } as const
    drawTo(screen, pyramidOf(gray(2, 1, 1)), { scale: 1, left: 1, top: 0 }, tone, 0, 2)
    expect([...screen.rgba].filter((_, i) => i % 4 === 3)).toEqual([0, 255, 0, 0])
  })
})

describe('comparison', () => {
  it('is zero for equal images and relative for others', () => {
    expect(differenceOf(gray(2, 2, 3), gray(2, 2, 3)).rgb[0]).toBe(0)
    expect(differenceOf(gray(1, 1, 3), gray(1, 1, 2)).rgb[0]).toBeCloseTo(1 / (4 + 0.04))
    expect(differenceOf(gray(1, 1, 0), gray(1, 1, 0)).rgb[0]).toBe(0)
    expect(() => differenceOf(gray(1, 2, 0), gray(2, 1, 0))).toThrow('1 × 2 and 2 × 1')
  })

  it('shows noise relative to the pixel', () => {
    expect(noiseOf(gray(1, 1, 2), gray(1, 1, 0.04)).rgb[0]).toBeCloseTo(0.1, 2)
  })

  it('reads sRGB back', () => {
    const { rgb } = fromSRGB(1, 1, Uint8ClampedArray.from([255, 0, 188, 9]))
    expect([rgb[0], rgb[1]]).toEqual([1, 0])
    expect(rgb[2]).toBeCloseTo(0.5, 2)
  })
})

it('halve takes means', () => {
  const image = {
    width: 2,
    height: 2,
    rgb: Float32Array.from([1, 2, 3, 1, 2, 3, 5, 6, 7, 5, 6, 7]),
  }
  expect([...halve(image).rgb]).toEqual([3, 4, 5])
  expect(pyramidOf(gray(256, 10, 1)).map(({ width }) => width)).toEqual([256, 128, 64])
})

it('keepRound keeps the first and the latest within its budget', () => {
  let kept: ReadonlyMap<number, Pixels> = new Map()
  for (const round of [1, 2, 3, 4, 5]) kept = keepRound(kept, round, gray(1, 1, round), 36)
  expect([...kept.keys()]).toEqual([1, 4, 5])
  expect([...keepRound(kept, 6, gray(1, 1, 6), 0).keys()]).toEqual([1, 6])
})

it('toPicture goes by the head of the answer alone', () => {
  const headers = new Headers({
    ETag: '"abc"',
    'Metrofarm-Rounds': '7',
    'Metrofarm-Mutations': '1200',
  })
  const pixels = gray(1, 1, 0)
  expect(toPicture(headers, pixels)).toEqual({ pixels, film: 'abc', round: 7, mutations: 1200 })
  headers.set('ETag', 'W/"abc"') // of a proxy that compresses
  expect(toPicture(headers, pixels).film).toBe('abc')
})
