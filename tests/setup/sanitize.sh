#!/usr/bin/env bash
# Builds the worker's unit tests under the address and undefined-behaviour sanitizers and runs them.
# usage: sanitize.sh [--short] [SANITIZERS]   default: address,undefined; thread is the other useful one
#   --short: only what handles bytes from outside (files, messages, images) and what they end up in
set -euo pipefail
cd "$(dirname "$0")/../.."

targets=()
if [ "${1:-}" = --short ]; then
  shift
  targets=(scene_file_test pbrt_test image_io_test texture_test film_test rpc_test work_unit_test
    fuzz_image fuzz_xml fuzz_obj fuzz_ply fuzz_serialized fuzz_pbrt)
fi
readonly sanitizers=${1:-address,undefined} targets
readonly dir=build/worker-${sanitizers//,/-}
# Embree and TBB keep memory until the process ends, which is no leak of ours.
export ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1

mkdir -p build
cmake -S worker -B "$dir" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DMETROFARM_SANITIZE="$sanitizers" \
  >"$dir.log" 2>&1 || { cat "$dir.log"; exit 1; }
if [ ${#targets[@]} -eq 0 ]; then
  cmake --build "$dir"
  ctest --test-dir "$dir" --output-on-failure -j 2
  exit
fi
cmake --build "$dir" --target "${targets[@]}"
for target in "${targets[@]}"; do
  [[ $target == fuzz_* ]] && continue
  echo "--- $target"
  "$(find "$dir/tests" -type f -name "$target")" --gtest_brief=1
done
ctest --test-dir "$dir" --output-on-failure --no-tests=error -R '^fuzz_.*_corpus$'
