// Server-sent events out of a stream of text (HTML standard, section 9.2.6). Pure.

export interface Message {
  /** Of this message, or of the last one that had one. */
  id: string
  event: string
  data: string
}

/** Takes text as it arrives and returns the messages that it completes. */
export class MessageParser {
  private rest = ''
  private id: string
  private event = ''
  private data: string[] = []

  constructor(lastId: string) {
    this.id = lastId
  }

  push(text: string): Message[] {
    const lines = (this.rest + text).split(/\r\n|\n/)
    this.rest = lines.pop() ?? ''
    return lines.flatMap((line) => this.line(line))
  }

  private line(line: string): Message[] {
    if (line === '') return this.dispatch()
    const colon = line.indexOf(':')
    const name = colon < 0 ? line : line.slice(0, colon)
    const value = colon < 0 ? '' : line.slice(colon + 1).replace(/^ /, '')
    if (name === 'id') this.id = value
    if (name === 'event') this.event = value
    if (name === 'data') this.data.push(value)
    return []
  }

  private dispatch(): Message[] {
    const message = { id: this.id, event: this.event || 'message', data: this.data.join('\n') }
    const empty = this.data.length === 0
    this.event = ''
    this.data = []
    return empty ? [] : [message]
  }
}
