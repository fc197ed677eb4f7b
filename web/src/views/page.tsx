// The frame around all pages: where one is, whether it is live, who one is.

import type { ComponentChildren } from 'preact'
import { useEffect, useRef } from 'preact/hooks'

import type { App } from '../app'
import type { Connection } from '../gateway'
import type { Route } from '../model/route'
import { formatRoute } from '../model/route'
import type { Actions, State } from '../state'
import { useStore } from '../store'
import { ComparePage } from './compare'
import { FarmPage } from './farm'
import { JobView } from './job'
import { SequencePage } from './sequence'
import { SubmitPage } from './submit'

const TITLE = 'Metrofarm'

export function Page({ app }: { app: App }) {
  const state = useStore(app.store)
  useEffect(() => {
    const job = state.page?.job
    document.title = job ? `${job.percent} % ${job.name} · ${TITLE}` : TITLE
  }, [state.page?.job])
  return (
    <>
      <TopBar state={state} actions={app.actions} />
      {state.connection === 'lost' && (
        <p class="stale" role="status">
          The coordinator does not answer. What is shown may be old; the page keeps trying.
        </p>
      )}
      {state.connection !== 'lost' && state.unread.size > 0 && (
        <p class="stale" role="status">
          Could not read {[...state.unread].join(', ')}. What is shown may be old; the page keeps
          trying.
        </p>
      )}
      {state.message !== '' && (
        <p class="message" role="alert">
          {state.message}
          <button type="button" onClick={app.actions.dismiss}>
            Dismiss
          </button>
        </p>
      )}
      <main>
        <Content state={state} actions={app.actions} />
      </main>
      <Login login={state.login} signIn={app.actions.signIn} />
    </>
  )
}

function Content({ state, actions }: { state: State; actions: Actions }) {
  switch (state.route.page) {
    case 'farm':
      return <FarmPage state={state} actions={actions} />
    case 'job':
      return <JobView state={state} actions={actions} />
    case 'sequence':
      return <SequencePage state={state} id={state.route.id} />
    case 'submit':
      return <SubmitPage state={state} actions={actions} clone={state.route.clone} />
    case 'compare':
      return <ComparePage state={state} actions={actions} ids={state.route.ids} />
  }
}

function TopBar({ state, actions }: { state: State; actions: Actions }) {
  const { route, session, picked } = state
  return (
    <header class="top">
      <a class="brand" href="#/">
        <img src="/icon.svg" alt="" width="20" height="20" /> {TITLE}
      </a>
      <nav aria-label="Pages">
        <Tab route={{ page: 'farm' }} here={route.page === 'farm' || route.page === 'job'}>
          Farm
        </Tab>
        <Tab route={{ page: 'submit', clone: null }} here={route.page === 'submit'}>
          New job
        </Tab>
        <Tab route={{ page: 'compare', ids: [...picked] }} here={route.page === 'compare'}>
          Compare{picked.size > 0 ? ` (${picked.size})` : ''}
        </Tab>
        <a href="/docs">REST</a>
      </nav>
      <Live connection={state.connection} />
      {session?.tokens === true && (
        <span class="user">
          {session.user} <small>{session.role}</small>{' '}
          <button type="button" onClick={actions.signOut}>
            Sign out
          </button>
        </span>
      )}
    </header>
  )
}

interface TabProps {
  route: Route
  here: boolean
  children: ComponentChildren
}

function Tab({ route, here, children }: TabProps) {
  return (
    <a href={formatRoute(route)} aria-current={here ? 'page' : undefined}>
      {children}
    </a>
  )
}

const LIVE: Record<Connection, string> = {
  connecting: 'connecting',
  live: 'live',
  lost: 'reconnecting',
}

function Live({ connection }: { connection: Connection | null }) {
  return (
    <span id="connection" class={connection ?? ''} role="status">
      {connection === null ? '' : LIVE[connection]}
    </span>
  )
}

interface LoginProps {
  login: State['login']
  signIn: (token: string) => void
}

function Login({ login, signIn }: LoginProps) {
  const dialog = useRef<HTMLDialogElement>(null)
  const token = useRef<HTMLInputElement>(null)
  useEffect(() => {
    if (login.open && dialog.current?.open === false) dialog.current.showModal()
    if (!login.open) dialog.current?.close()
  }, [login.open])
  return (
    <dialog ref={dialog} id="login" aria-label="Sign in">
      <form
        onSubmit={(event) => {
          event.preventDefault()
          signIn(token.current?.value.trim() ?? '')
        }}
      >
        <input type="text" autocomplete="username" value="token" hidden readOnly />
        <label for="token">Token</label>
        <input ref={token} id="token" type="password" autocomplete="current-password" required />
        {login.problem !== '' && <p role="alert">{login.problem}</p>}
        <button type="submit" class="primary">
          Sign in
        </button>
      </form>
    </dialog>
  )
}
