#!/usr/bin/env bash
# Builds the worker's unit tests under the address and undefined-behaviour sanitizers and runs them.
# usage: sanitize.sh [SANITIZERS]        default: address,undefined; thread is the other useful one
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly sanitizers=${1:-address,undefined}
readonly dir=build/worker-${sanitizers//,/-}

mkdir -p build
cmake -S worker -B "$dir" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DMETROFARM_SANITIZE="$sanitizers" \
  >"$dir.log" 2>&1 || { cat "$dir.log"; exit 1; }
cmake --build "$dir"
# Embree and TBB keep memory until the process ends, which is no leak of ours.
ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1 \
  ctest --test-dir "$dir" --output-on-failure -j 2
