#!/usr/bin/env bash
# Format checks and linters.
#
# usage: lint.sh all                every check below; one line per check, output on failure only
#        lint.sh NAME...            some of: cpp tidy go proto web python shell
#        lint.sh format             rewrites sources instead of checking them
set -uo pipefail
cd "$(dirname "$0")/../.." || exit
# shellcheck source=tests/setup/environment.sh
. tests/setup/environment.sh

cpp_sources() { find worker -name '*.cpp' -o -name '*.h' | sort; }
shell_sources() { { echo .ci/run; find tests services deploy -name '*.sh'; } | sort; }

check_cpp() {
  local unformatted
  unformatted=$(cpp_sources | xargs clang-format-19 --dry-run 2>&1 | sed -nE 's/^([^ :]+):[0-9].*/\1/p' | sort -u)
  [ -z "$unformatted" ] || { echo "not formatted (make format):"; echo "$unformatted"; return 1; }
}

# clang-tidy needs the flags of every file and the headers that protobuf generates, so it runs after
# a build. A file that passed is not checked again until it, a header or the checks change.
check_tidy() {
  [ -f build/worker/compile_commands.json ] || {
    echo "build/worker/compile_commands.json is missing; run make build first"
    return 1
  }
  local stamps=build/tidy common file
  mkdir -p "$stamps"
  common=$({ cat worker/.clang-tidy; find worker -name '*.h' | sort | xargs cat; } | sha256sum)
  find worker -name '*.cpp' -not -path '*/tests/*' | sort | while read -r file; do
    local key
    key=$({ echo "$common"; cat "$file"; } | sha256sum | cut -c1-32)
    [ -f "$stamps/$key" ] || echo "$file $stamps/$key"
  done | xargs -r -P 2 -L 1 tests/setup/lint.sh tidy-one
}

# tidy_one SOURCE STAMP
tidy_one() { clang-tidy -p build/worker --quiet "$1" && touch "$2"; }

check_go() {
  (
    cd services || exit 1
    local unformatted
    unformatted=$(gofumpt -l checksum cmd internal ../tests/deploy ../tests/chaos/proxy) || exit 1
    if [ -n "$unformatted" ]; then
      echo "not formatted by gofumpt: $unformatted"
      exit 1
    fi
    go vet ./... && staticcheck ./...
  )
}

check_proto() { (cd proto && buf format --diff --exit-code && buf lint); }

# Outside of the normal build, hence its own installation of the packages.
install_web() {
  cmp -s web/package-lock.json web/node_modules/.installed-lock.json && return 0
  (cd web && npm ci --no-audit --no-fund --loglevel=error) &&
    cp web/package-lock.json web/node_modules/.installed-lock.json
}

check_web() { install_web && (cd web && npm run --silent check); }
check_python() { ruff format --check tests && ruff check tests; }
check_shell() { shell_sources | xargs shellcheck; }

run_check() {
  local output
  if output=$("check_$1" 2>&1); then
    echo "lint $1: ok"
  else
    printf 'lint %s: FAILED\n%s\n' "$1" "$output"
    return 1
  fi
}

format_all() {
  cpp_sources | xargs clang-format-19 -i
  (cd services && gofumpt -w checksum cmd internal ../tests/deploy ../tests/chaos/proxy)
  (cd proto && buf format -w)
  install_web && (cd web && npm run --silent format)
  ruff format tests && ruff check --fix tests
}

main() {
  [ $# -gt 0 ] || set -- all
  [ "$1" != tidy-one ] || { tidy_one "$2" "$3"; return; }
  [ "$1" != format ] || { format_all; return; }
  [ "$1" != all ] || set -- cpp tidy go proto web python shell
  local name failed=0
  for name in "$@"; do
    run_check "$name" || failed=1
  done
  return "$failed"
}

main "$@"
