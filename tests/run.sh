#!/usr/bin/env bash
# All checks, in the order in which they are cheapest to fail. Every stage runs, so that one report
# shows all that is wrong; only a failed build ends the run early.
#
# usage: tests/run.sh [STAGE...]         default: all of them
set -uo pipefail
cd "$(dirname "$0")/.." || exit
# shellcheck source=tests/setup/environment.sh
. tests/setup/environment.sh

readonly STAGES=(setup build lint generated cpp go web instrument e2e agreement sanitize)

stage_setup() { tests/setup/setup.sh test; }
stage_build() { make --no-print-directory build; }
stage_lint() { tests/setup/lint.sh all; }

# Generated files that are committed must be what the generators make now.
stage_generated() {
  local before=build/generated-before
  rm -rf "$before" && mkdir -p "$before" &&
    cp -r services/gen "$before/gen" && cp -r services/internal/api/web "$before/web" &&
    services/generate.sh && make --no-print-directory web >/dev/null || return
  diff -r "$before/gen" services/gen && diff -r "$before/web" services/internal/api/web && return
  echo "generated files were stale (left: before, right: now); commit what has just been made"
  return 1
}

stage_cpp() {
  make --no-print-directory worker-tests &&
    ctest --test-dir build/worker --output-on-failure --no-tests=error -j 2
}
stage_go() { (cd services && go test -race ./...); }
stage_web() { (cd web && npm test --silent); }
stage_instrument() { python -m pytest -q tests/agreement/test_tiles.py tests/sabotage; }
stage_e2e() { python -m pytest -q tests/e2e; }
stage_agreement() { python -m pytest -q tests/agreement --ignore=tests/agreement/test_tiles.py; }
stage_sanitize() { tests/setup/sanitize.sh --short address,undefined; }

report=()
failures=0

run_stage() {
  local name=$1 started=$SECONDS verdict=ok
  printf '\n=== %s\n' "$name"
  "stage_$name" || { verdict=FAILED; failures=$((failures + 1)); }
  report+=("$(printf '%-12s %-7s %4d s' "$name" "$verdict" $((SECONDS - started)))")
  echo "=== $name: $verdict, $((SECONDS - started)) s"
  [ "$verdict" = ok ]
}

main() {
  [ $# -gt 0 ] || set -- "${STAGES[@]}"
  local name
  for name in "$@"; do
    declare -F "stage_$name" >/dev/null || { echo "no such stage: $name (${STAGES[*]})" >&2; exit 2; }
  done
  for name in "$@"; do
    run_stage "$name" && continue
    case $name in setup | build) break ;; esac
  done
  printf '\n=== summary\n'
  printf '%s\n' "${report[@]}"
  echo "$SECONDS s in all; $failures of ${#report[@]} stages failed"
  [ "$failures" -eq 0 ] && [ "${#report[@]}" -eq $# ]
}

main "$@"
