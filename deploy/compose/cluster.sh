#!/usr/bin/env bash
# The compose cluster, and a scene rendered on it by curl alone.
#
# usage: cluster.sh demo      start it, render CLUSTER_SCENE, say where the results are
#        cluster.sh up        start it only, and write how to reach it to CLUSTER_OUT
#        cluster.sh down      stop it; jobs, scenes and keys stay for the next start
#        cluster.sh destroy   stop it and delete all that it holds
#
# CLUSTER_WORKERS (3)        worker containers
# CLUSTER_SCENE              (tests/scenes/door-ajar/scene.xml) its folder is uploaded
# CLUSTER_REQUEST            JSON members of the job beside scene and entry
# CLUSTER_OUT (demo/cluster) token, certificate and images go here
# CLUSTER_PROJECT            (metrofarm) the prefix of all names in the container engine
# What docker-compose.yml names at its top can be set too.
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly workers=${CLUSTER_WORKERS:-3} scene=${CLUSTER_SCENE:-tests/scenes/door-ajar/scene.xml}
readonly request=${CLUSTER_REQUEST:-'"integrator":"pssmlt","stop":{"time_seconds":120}'}
readonly out=${CLUSTER_OUT:-demo/cluster} project=${CLUSTER_PROJECT:-metrofarm}
readonly host=${METROFARM_HOST:-localhost} port=${METROFARM_PORT:-8443}
readonly url=https://$host:$port

say() { echo "cluster: $*" >&2; }

die() {
  say "$*"
  exit 1
}

# Compose 2 is a plugin of docker, Compose 1.29 (Debian 12) a program of its own.
compose() {
  if docker compose version >/dev/null 2>&1; then
    docker compose -p "$project" -f deploy/compose/docker-compose.yml "$@"
  elif command -v docker-compose >/dev/null; then
    docker-compose -p "$project" -f deploy/compose/docker-compose.yml "$@"
  else
    die "needs docker with its compose plugin, or docker-compose 1.29 or newer"
  fi
}

# rest METHOD PATH [CURL OPTION...]: the body of the answer; fails with the problem that it tells.
rest() {
  local method=$1 path=$2 body=$out/answer status
  shift 2
  # A coordinator may be lost at any moment; every request here is safe to repeat.
  status=$(curl --silent --show-error --cacert "$out/ca.crt" --header "@$out/authorization" \
    --retry 10 --retry-delay 1 --retry-connrefused --request "$method" \
    --output "$body" --write-out '%{http_code}' "$@" "$url$path") || die "$method $path failed"
  [[ $status == 2?? ]] || die "$method $path: status $status: $(cat "$body")"
  cat "$body"
}

# member NAME: the value of the first member of this name in the JSON on standard input, if any.
member() {
  { grep -oE "\"$1\":(\"[^\"]*\"|[^,}]*)" || true; } | head -n 1 | sed -E 's/^[^:]*:"?//; s/"$//'
}

fetch_keys() {
  mkdir -p "$out"
  (
    umask 077
    compose run --rm -T --no-deps --entrypoint cat keys /keys/client/token >"$out/token"
    compose run --rm -T --no-deps --entrypoint cat keys /keys/client/ca.crt >"$out/ca.crt"
    echo "Authorization: Bearer $(cat "$out/token")" >"$out/authorization"
  )
  [ -s "$out/token" ] || die "no token; docker logs of the container keys says why"
}

wait_until_ready() {
  local attempt
  for attempt in $(seq 90); do
    curl --silent --fail --output /dev/null --cacert "$out/ca.crt" "$url/readyz" && return 0
    sleep 1
  done
  compose ps >&2 || true
  compose logs --tail=30 coordinator-1 proxy >&2 || true
  die "$url does not answer after $attempt s"
}

up() {
  command -v docker >/dev/null || die "needs docker"
  docker info >/dev/null 2>&1 || die "no container engine answers; is dockerd running?"
  say "starting redis, 2 coordinators, $workers workers and prometheus; images are built if missing"
  compose up -d --scale "worker=$workers"
  fetch_keys
  wait_until_ready
}

upload() {
  tar --create --directory "$(dirname "$scene")" . |
    rest POST /v1/scenes --header 'Content-Type: application/x-tar' --data-binary @- | member digest
}

submit() {
  rest POST /v1/jobs --header 'Content-Type: application/json' \
    --header "Idempotency-Key: cluster-$$-$RANDOM$RANDOM" \
    --data "{\"scene\":\"$1\",\"entry\":\"$(basename "$scene")\",$request}" | member id
}

# follow JOB: prints how far it is until it ends; fails unless it is done.
follow() {
  local snapshot state last='' line
  while true; do
    snapshot=$(rest GET "/v1/jobs/$1")
    state=$(member state <<<"$snapshot")
    line="$state, $(member progress <<<"$snapshot" | awk '{printf "%.0f", int($1 * 100)}') %, round"
    line+=" $(member rounds_done <<<"$snapshot"), error $(member rel_mse <<<"$snapshot")"
    [ "$line" = "$last" ] || echo "  $line"
    last=$line
    case $state in
      done) return 0 ;;
      failed | canceled) die "the job is $state: $(member error <<<"$snapshot")" ;;
    esac
    sleep 2
  done
}

demo() {
  up
  local digest job name
  name=$(basename "$(dirname "$scene")")
  digest=$(upload)
  job=$(submit "$digest")
  echo "Rendering $scene as $job; watch it at $url/"
  follow "$job"
  rest GET "/v1/jobs/$job/image.exr" >"$out/$name.exr"
  rest GET "/v1/jobs/$job/image.png" >"$out/$name.png"
  cat <<END

Film       $(rest GET "/v1/jobs/$job" | member film_sha256)
EXR        $out/$name.exr
PNG        $out/$name.png
Dashboard  $url/ (its certificate is signed by $out/ca.crt; log in with the token in $out/token)
Prometheus http://127.0.0.1:${PROMETHEUS_PORT:-9091}/
make cluster-down stops the cluster.
END
}

case ${1:-} in
  demo) demo ;;
  up) up ;;
  down) compose down ;;
  destroy) compose down --volumes ;;
  *) die "usage: cluster.sh demo|up|down|destroy" ;;
esac
