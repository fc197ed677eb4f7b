// Numbers as people read them.

export function short(x: number): string {
  return String(Number(x.toPrecision(3)))
}

/** A share as a percentage, floored: what is shown as 100 % is all of it. */
export function percent(x: number): string {
  return `${Math.floor(x * 1000) / 10} %`
}

export function metric(x: number): string {
  for (const prefix of ['', ' k', ' M', ' G']) {
    if (x < 999.5) return short(x) + prefix
    x /= 1000
  }
  return `${short(x)} T`
}

const pad = (n: number) => String(n).padStart(2, '0')

export function duration(seconds: number): string {
  const whole = Math.ceil(seconds)
  if (whole >= 86400) return `${Math.floor(whole / 86400)} d ${Math.floor(whole / 3600) % 24} h`
  if (whole >= 3600) return `${Math.floor(whole / 3600)} h ${pad(Math.floor(whole / 60) % 60)} min`
  if (whole >= 60) return `${Math.floor(whole / 60)} min ${pad(whole % 60)} s`
  return `${whole} s`
}

export function bytes(n: number): string {
  if (n < 1024) return `${n} B`
  if (n < 1 << 20) return `${short(n / 1024)} KiB`
  return n < 1 << 30 ? `${short(n / (1 << 20))} MiB` : `${short(n / (1 << 30))} GiB`
}

/** How long ago something was; clocks that differ a little make no negative times. */
export function ago(then: number, now: number): string {
  const seconds = Math.max(0, Math.floor((now - then) / 1000))
  if (seconds < 2) return 'now'
  // Whole minutes are enough for what is not of this minute.
  const shown = seconds < 60 ? `${seconds} s` : duration(seconds).replace(/ \d+ s$/, '')
  return `${shown} ago`
}
