# Sourced by the scripts: from the repository's root, the pinned tools before the machine's.
# shellcheck shell=bash
PATH=$PWD/.tools/bin:$PWD/.tools/python/bin:$PWD/.tools/go:$PATH
GOTOOLCHAIN=local
METROFARM_TOOLS=$PWD/.tools/go
export PATH GOTOOLCHAIN METROFARM_TOOLS
