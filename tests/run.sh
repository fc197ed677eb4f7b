#!/usr/bin/env bash
# All checks. Every stage runs, so that one report shows all that is wrong; only a failed build ends
# the run early.
#
# usage: tests/run.sh [STAGE...]         default: all of them, the last two beside the others
set -uo pipefail
cd "$(dirname "$0")/.." || exit
# shellcheck source=tests/setup/environment.sh
. tests/setup/environment.sh

readonly FIRST=(setup build generated web)
readonly THEN=(cpp go instrument e2e page chaos load deploy cluster agreement)
# Long ones that only compute: they take what THEN leaves of the cores while it waits.
readonly BESIDE=(lint sanitize)
readonly STAGES=("${FIRST[@]}" "${THEN[@]}" "${BESIDE[@]}")
readonly LOGS=build/stages

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
  make --no-print-directory worker-tests || return
  local -r test=(ctest --test-dir build/worker --output-on-failure --no-tests=error -j 2)
  "${test[@]}" || { again && "${test[@]}" --rerun-failed; }
}
# What passed is cached, so that the second try is of the packages that failed.
stage_go() { (cd services && go test -race ./...) || { again && (cd services && go test -race ./...); }; }
stage_web() { (cd web && npm test --silent); }
stage_instrument() { python -m pytest -q tests/agreement/test_tiles.py tests/agreement/test_poses.py tests/sabotage; }
stage_e2e() {
  local -r rare=tests/e2e/test_determinism.py
  try_pytest tests/e2e --ignore="$rare" && python -m pytest -q "$rare"
}
# The browser's tests need axe-core, which npm brings.
stage_page() {
  [ -e web/node_modules/axe-core ] || (cd web && npm ci --no-audit --no-fund --loglevel=error) || return
  try_pytest tests/page
}
stage_chaos() { (cd tests/chaos/proxy && go vet ./... && go test ./...) && python -m pytest -q -s tests/chaos; }
stage_load() { try_pytest tests/load; }
stage_deploy() { (cd tests/deploy && go vet ./... && go test ./...); }
stage_cluster() { try_pytest tests/cluster; }
stage_agreement() {
  python -m pytest -q tests/agreement --ignore=tests/agreement/test_tiles.py --ignore=tests/agreement/test_poses.py
}
stage_sanitize() { tests/setup/sanitize.sh --short address,undefined; }

# Tests that wait for processes, sockets and clocks can fail on a busy machine for no fault of the
# code. What failed of them gets a second try, and the summary says so: a test that is unsteady is a
# bug to be found, but no word on the change at hand. What only computes has one try, and so has what
# looks for a loss that is rare: films after kills, chaos.
try_pytest() { python -m pytest -q "$@" || { again && python -m pytest -q --last-failed "$@"; }; }

again() {
  tries=2
  printf '\n=== once more, what failed\n'
}

report=()
failures=0
tries=1

note_stage() { # NAME VERDICT SECONDS TRIES
  local remark=""
  [ "$4" = 1 ] || remark=" (UNSTEADY: something failed at the first try)"
  report+=("$(printf '%-12s %-7s %4d s%s' "$1" "$2" "$3" "$remark")")
  echo "=== $1: $2, $3 s"
  [ "$2" = ok ] || failures=$((failures + 1))
  [ "$2" = ok ]
}

run_stage() {
  local name=$1 started=$SECONDS verdict=ok
  tries=1
  printf '\n=== %s\n' "$name"
  "stage_$name" || verdict=FAILED
  note_stage "$name" "$verdict" $((SECONDS - started)) "$tries"
}

# One after another, each with a log and a file that says what came of it.
run_beside() {
  renice -n 19 -p "$BASHPID" >/dev/null
  local name started verdict
  for name in "${BESIDE[@]}"; do
    started=$SECONDS verdict=ok
    "stage_$name" >"$LOGS/$name.log" 2>&1 || verdict=FAILED
    echo "$verdict $((SECONDS - started))" >"$LOGS/$name.verdict"
  done
}

await_beside() {
  local name verdict seconds
  wait "$1"
  for name in "${BESIDE[@]}"; do
    printf '\n=== %s (beside the others)\n' "$name"
    cat "$LOGS/$name.log"
    read -r verdict seconds <"$LOGS/$name.verdict"
    note_stage "$name" "$verdict" "$seconds" 1
  done
}

run_stages() {
  local name
  for name in "$@"; do
    run_stage "$name" && continue
    case $name in setup | build) return 1 ;; esac
  done
}

run_all() {
  rm -rf "$LOGS" && mkdir -p "$LOGS"
  run_stages "${FIRST[@]}" || return
  run_beside &
  local beside=$!
  run_stages "${THEN[@]}"
  await_beside "$beside"
}

main() {
  local name wanted=$#
  for name in "$@"; do
    declare -F "stage_$name" >/dev/null ||
      { echo "no such stage: $name (${STAGES[*]})" >&2; exit 2; }
  done
  if [ "$wanted" -gt 0 ]; then
    run_stages "$@"
  else
    wanted=${#STAGES[@]}
    run_all
  fi
  printf '\n=== summary\n'
  printf '%s\n' "${report[@]}"
  echo "$SECONDS s in all; $failures of ${#report[@]} stages failed"
  [ "$failures" -eq 0 ] && [ "${#report[@]}" -eq "$wanted" ]
}

main "$@"
