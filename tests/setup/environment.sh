# Sourced by the scripts: from the repository's root, the pinned tools before the machine's.
# shellcheck shell=bash
PATH=$PWD/.tools/bin:$PWD/.tools/python/bin:$PWD/.tools/go:$PATH
GOTOOLCHAIN=local
METROFARM_TOOLS=$PWD/.tools/go
CMAKE_CXX_COMPILER_LAUNCHER=ccache
CCACHE_BASEDIR=$PWD
CCACHE_NOHASHDIR=1
export PATH GOTOOLCHAIN METROFARM_TOOLS CMAKE_CXX_COMPILER_LAUNCHER CCACHE_BASEDIR CCACHE_NOHASHDIR
