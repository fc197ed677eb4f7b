// Images of floats: portable float maps, smaller copies to look at from afar, and what compares two.

/** An image of linear values, three per pixel, row by row from the top. */
export interface Pixels {
  width: number
  height: number
  rgb: Float32Array
}

/** An image with what it shows, as one answer told of both: the job goes on while one reads. */
export interface Picture {
  pixels: Pixels
  film: string
  /** Complete rounds, and the mutations in them. */
  round: number
  mutations: number
}

/** What an answer shows, by its head. */
export function toPicture(headers: Headers, pixels: Pixels): Picture {
  return {
    pixels,
    film: (headers.get('ETag') ?? '').replace(/^W\/|"/g, ''),
    round: Number(headers.get('Metrofarm-Rounds')),
    mutations: Number(headers.get('Metrofarm-Mutations')),
  }
}

const HEAD = /^(PF|Pf)\s+(\d+)\s+(\d+)\s+(-?[\d.eE+]+)\s/

/** Reads a portable float map; an error says what is wrong with it. */
export function parsePFM(buffer: ArrayBuffer): Pixels {
  const head = HEAD.exec(new TextDecoder('latin1').decode(buffer.slice(0, 128)))
  if (head === null) throw new Error('this is no portable float map')
  const [text, kind] = head
  const [width, height, scale] = [Number(head[2]), Number(head[3]), Number(head[4])]
  const channels = kind === 'PF' ? 3 : 1
  const size = width * height * channels * 4
  if (width < 1 || height < 1 || buffer.byteLength - text.length < size) {
    throw new Error(`the float map of ${width} × ${height} is cut off`)
  }
  const view = new DataView(buffer, text.length, size)
  const rgb = new Float32Array(3 * width * height)
  for (let y = 0; y < height; y++) {
    const row = (height - 1 - y) * width * channels * 4
    for (let i = 0; i < 3 * width; i++) {
      const at = channels === 3 ? i : Math.floor(i / 3)
      rgb[3 * width * y + i] = view.getFloat32(row + 4 * at, scale < 0)
    }
  }
  return { width, height, rgb }
}

/** Linear values of 8-bit sRGB, with alpha left out. */
export function fromSRGB(width: number, height: number, rgba: Uint8ClampedArray): Pixels {
  const linear = Float32Array.from({ length: 256 }, (_, code) => {
    const v = code / 255
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4
  })
  const rgb = new Float32Array(3 * width * height)
  for (let p = 0, i = 0; i < rgb.length; p += 4) {
    for (let c = 0; c < 3; c++) rgb[i++] = linear[rgba[p + c] ?? 0] ?? 0
  }
  return { width, height, rgb }
}

export type Rgb = [number, number, number]

export function at({ width, height, rgb }: Pixels, x: number, y: number): Rgb | null {
  if (x < 0 || y < 0 || x >= width || y >= height) return null
  const i = 3 * (y * width + x)
  return [rgb[i] ?? 0, rgb[i + 1] ?? 0, rgb[i + 2] ?? 0]
}

export const luminance = ([r, g, b]: Rgb) => 0.2126 * r + 0.7152 * g + 0.0722 * b

/** Half as wide and high: means of 2 × 2 pixels. */
export function halve(image: Pixels): Pixels {
  const width = Math.max(1, image.width >> 1)
  const height = Math.max(1, image.height >> 1)
  const rgb = new Float32Array(3 * width * height)
  const right = image.width > 1 ? 3 : 0
  const below = image.height > 1 ? 3 * image.width : 0
  for (let y = 0, i = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const from = 3 * (2 * y * image.width + 2 * x)
      for (let c = 0; c < 3; c++, i++) {
        const [a, b] = [from + c, from + c + below]
        rgb[i] =
          ((image.rgb[a] ?? 0) +
            (image.rgb[a + right] ?? 0) +
            (image.rgb[b] ?? 0) +
            (image.rgb[b + right] ?? 0)) /
          4
      }
    }
  }
  return { width, height, rgb }
}

/** An image with its smaller copies, the largest first. */
export type Pyramid = readonly [Pixels, ...Pixels[]]

export function pyramidOf(image: Pixels): Pyramid {
  const levels: [Pixels, ...Pixels[]] = [image]
  for (let last = image; Math.max(last.width, last.height) > 64;) {
    last = halve(last)
    levels.push(last)
  }
  return levels
}

/** Share of the mean square that keeps relative errors of dark pixels finite. */
const FLOOR = 0.01

/** The relative squared error of each pixel of an image against another, in all channels alike. */
export function differenceOf(image: Pixels, reference: Pixels): Pixels {
  if (image.width !== reference.width || image.height !== reference.height) {
    throw new Error(
      `sizes differ: ${image.width} × ${image.height} and ${reference.width} × ${reference.height}`,
    )
  }
  const floor = FLOOR * meanSquare(reference)
  return perPixel(image, (i) => {
    let sum = 0
    for (let c = i; c < i + 3; c++) {
      const b = reference.rgb[c] ?? 0
      sum += ((image.rgb[c] ?? 0) - b) ** 2 / (b * b + floor || 1)
    }
    return sum / 3
  })
}

/** The relative standard error of each pixel, from the variance of its mean. */
export function noiseOf(image: Pixels, variance: Pixels): Pixels {
  const floor = FLOOR * meanSquare(image)
  return perPixel(image, (i) => {
    let [square, noise] = [0, 0]
    for (let c = i; c < i + 3; c++) {
      square += (image.rgb[c] ?? 0) ** 2
      noise += Math.max(0, variance.rgb[c] ?? 0)
    }
    return Math.sqrt(noise / (square + 3 * floor || 1))
  })
}

function perPixel(image: Pixels, value: (i: number) => number): Pixels {
  const rgb = new Float32Array(image.rgb.length)
  for (let i = 0; i < rgb.length; i += 3) rgb.fill(value(i), i, i + 3)
  return { width: image.width, height: image.height, rgb }
}

function meanSquare({ rgb }: Pixels): number {
  let sum = 0
  for (const value of rgb) sum += value * value
  return rgb.length === 0 ? 0 : sum / rgb.length
}

export function meanOf({ rgb }: Pixels): number {
  let sum = 0
  for (const value of rgb) sum += value
  return rgb.length === 0 ? 0 : sum / rgb.length
}

/** Images of earlier rounds, as many as fit in a number of bytes: the first and the latest stay. */
export function keepRound(
  kept: ReadonlyMap<number, Pixels>,
  round: number,
  image: Pixels,
  budget: number,
): Map<number, Pixels> {
  const next = new Map(kept).set(round, image)
  const size = () => [...next.values()].reduce((sum, { rgb }) => sum + rgb.byteLength, 0)
  while (next.size > 2 && size() > budget) {
    const second = [...next.keys()][1]
    if (second === undefined) break
    next.delete(second)
  }
  return next
}
