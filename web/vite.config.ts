import { defineConfig } from 'vitest/config'

// The built page is committed with the coordinator, which embeds it. File names carry no hash: the
// coordinator sends an ETag, and the diff of a rebuild stays readable.
export default defineConfig({
  build: {
    outDir: '../services/internal/api/web',
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: false,
    rolldownOptions: {
      output: { entryFileNames: 'app.js', assetFileNames: 'app[extname]' },
    },
  },
  test: { environment: 'node' },
})
