import js from '@eslint/js'
import tseslint from 'typescript-eslint'

export default tseslint.config(
  { ignores: ['node_modules'] },
  js.configs.recommended,
  {
    files: ['**/*.{ts,tsx}'],
    extends: [...tseslint.configs.strictTypeChecked],
    languageOptions: {
      parserOptions: { projectService: true, tsconfigRootDir: import.meta.dirname },
    },
    rules: {
      '@typescript-eslint/restrict-template-expressions': ['error', { allowNumber: true }],
      // Only the gateway talks to the server.
      'no-restricted-globals': ['error', 'fetch', 'EventSource', 'XMLHttpRequest'],
    },
  },
  { files: ['src/gateway.ts'], rules: { 'no-restricted-globals': 'off' } },
)
