// Addresses within the page. Pure.

export type Route =
  | { page: 'farm' }
  | { page: 'job'; id: string }
  | { page: 'sequence'; id: string }
  | { page: 'submit'; clone: string | null }
  | { page: 'compare'; ids: string[] }

export function parseRoute(hash: string): Route {
  const [page = '', rest = ''] = hash.replace(/^#\/?/, '').split('/')
  const words = rest.split(',').filter(Boolean).map(decode)
  switch (page) {
    case 'jobs':
      return words[0] === undefined ? { page: 'farm' } : { page: 'job', id: words[0] }
    case 'sequences':
      return words[0] === undefined ? { page: 'farm' } : { page: 'sequence', id: words[0] }
    case 'submit':
      return { page: 'submit', clone: words[0] ?? null }
    case 'compare':
      return { page: 'compare', ids: words }
    default:
      return { page: 'farm' }
  }
}

function decode(word: string): string {
  try {
    return decodeURIComponent(word)
  } catch {
    return word // a stray percent sign is one
  }
}

export function formatRoute(route: Route): string {
  switch (route.page) {
    case 'farm':
      return '#/'
    case 'job':
      return `#/jobs/${encodeURIComponent(route.id)}`
    case 'sequence':
      return `#/sequences/${encodeURIComponent(route.id)}`
    case 'submit':
      return route.clone === null ? '#/submit' : `#/submit/${encodeURIComponent(route.clone)}`
    case 'compare':
      return `#/compare/${route.ids.map(encodeURIComponent).join(',')}`
  }
}
