#!/usr/bin/env bash
# Fails when a path differs from what is committed, or holds files that are not.
# usage: unchanged.sh PATH...
set -euo pipefail
cd "$(dirname "$0")/../.."

changed=$(git status --porcelain --untracked-files=all -- "$@")
[ -z "$changed" ] && exit 0
echo "differs from what is committed (commit what the generator made):"
echo "$changed"
git --no-pager diff --stat -- "$@"
exit 1
