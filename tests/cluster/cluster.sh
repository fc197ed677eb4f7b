#!/usr/bin/env bash
# From a bare Debian 12 to a container engine with a base image, for tests/cluster: installs docker
# and debootstrap, starts dockerd where none answers, makes debian:bookworm-slim where it cannot be
# pulled, and builds the images from bin/.
#
# usage: cluster.sh engine       prints "ready", or one line that says why no engine can run here
#        cluster.sh images       base image and ours; needs bin/ (make build)
#        cluster.sh stop         ends the dockerd that engine started, if it did
#
# CLUSTER_STATE (/tmp/metrofarm-cluster)   data and log of the dockerd that is started
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly state=${CLUSTER_STATE:-/tmp/metrofarm-cluster}
readonly base=debian:bookworm-slim

refuse() {
  echo "no container engine can run here: $*"
  exit 0
}

install_packages() {
  local missing=()
  command -v dockerd >/dev/null || missing+=(docker.io iptables)
  command -v docker-compose >/dev/null || docker compose version >/dev/null 2>&1 || missing+=(docker-compose)
  command -v debootstrap >/dev/null || missing+=(debootstrap)
  [ "${#missing[@]}" -gt 0 ] || return 0
  [ "$(id -u)" -eq 0 ] || refuse "not root, and these packages are missing: ${missing[*]}"
  command -v apt-get >/dev/null || refuse "no Debian, and these are missing: ${missing[*]}"
  # The package would start a service; the one that is needed is started below.
  local guard=/usr/sbin/policy-rc.d
  [ -e "$guard" ] || { printf '#!/bin/sh\nexit 101\n' >"$guard" && chmod 755 "$guard" && trap 'rm -f /usr/sbin/policy-rc.d' EXIT; }
  apt-get update -qq >&2 || refuse "apt-get update failed"
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >&2 ||
    refuse "apt-get install ${missing[*]} failed"
}

answers() { docker info >/dev/null 2>&1; }

# start_engine OPTION...: true once it answers.
start_engine() {
  local attempt
  mkdir -p "$state"
  setsid dockerd --data-root "$state/data" --exec-root "$state/run" --pidfile "$state/pid" \
    "$@" >"$state/log" 2>&1 </dev/null &
  for attempt in $(seq 60); do
    answers && return 0
    kill -0 $! 2>/dev/null || break
    sleep 0.5
  done
  echo "dockerd $* did not start (attempt $attempt)" >&2
  stop_engine
  return 1
}

stop_engine() {
  [ -s "$state/pid" ] || return 0
  local pid
  pid=$(cat "$state/pid")
  kill "$pid" 2>/dev/null || return 0
  for _ in $(seq 60); do
    kill -0 "$pid" 2>/dev/null || break
    sleep 0.5
  done
}

engine() {
  answers || {
    install_packages
    [ "$(id -u)" -eq 0 ] || refuse "not root"
    # Where the kernel has no packet filter, containers reach each other all the same, and published
    # ports go through docker's own proxy.
    start_engine || start_engine --iptables=false --ip6tables=false ||
      refuse "dockerd does not start: $(tail -n 1 "$state/log")"
  }
  install_packages
  docker run --rm "$(tiny_image)" /true >/dev/null 2>"$state/error" ||
    refuse "a container does not start: $(tail -n 1 "$state/error")"
  echo ready
}

# tiny_image: a static program that succeeds, to see whether containers start at all.
tiny_image() {
  local folder
  mkdir -p "$state"
  folder=$(mktemp -d)
  echo 'int main(void) { return 0; }' | gcc -static -x c -o "$folder/true" - >&2
  tar --create --directory "$folder" true | docker import - metrofarm-true:local >/dev/null
  rm -rf "$folder"
  echo metrofarm-true:local
}

base_image() {
  docker image inspect "$base" >/dev/null 2>&1 && return 0
  timeout 60 docker pull --quiet "$base" >/dev/null 2>&1 && return 0
  install_packages
  local root
  root=$(mktemp -d)
  debootstrap --variant=minbase bookworm "$root" >&2
  # The same packages as this machine: its sources, and how apt reaches them.
  cp -a /etc/apt/. "$root/etc/apt/"
  rm -rf "$root"/var/cache/apt/* "$root"/var/lib/apt/lists/* "$root"/usr/share/doc/* "$root"/usr/share/man/*
  tar --create --directory "$root" --exclude ./dev --exclude ./proc --exclude ./sys . |
    docker import --change 'CMD ["bash"]' - "$base" >/dev/null
  rm -rf "$root"
}

images() {
  if ! [ -x bin/metrofarm ] || ! [ -x bin/metrofarm-worker ]; then
    echo "cluster.sh: bin/ is empty; make build fills it" >&2
    exit 1
  fi
  base_image
  local target
  for target in coordinator worker redis proxy prometheus; do
    # The host's network: a cluster without a packet filter has no other way to Debian's packages.
    docker build --quiet --network host --build-arg "BASE=$base" --build-arg PROGRAMS=prebuilt \
      --file deploy/docker/Dockerfile --target "$target" --tag "metrofarm-$target" . >&2
  done
  docker images --format '{{.Repository}} {{.Size}}' | grep '^metrofarm-'
}

case ${1:-} in
  engine) engine ;;
  images) images ;;
  stop) stop_engine ;;
  *)
    echo "usage: cluster.sh engine|images|stop" >&2
    exit 2
    ;;
esac
