import { render } from 'preact'

import { App } from './app'
import { Page } from './views/page'
import './style.css' // after the charts' own style, which it adjusts

const app = new App()
const root = document.getElementById('app')
if (root === null) throw new Error('the page has no element app')
render(<Page app={app} />, root)
window.addEventListener('hashchange', () => {
  app.route()
})
app.start()
