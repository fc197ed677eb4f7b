#!/bin/bash
# Makes what a cluster on one machine needs to trust itself, once: a private authority, certificates
# and tokens. Each part of the cluster gets its own folder with no more than it needs. For a cluster
# that others use, bring certificates and tokens of your own in the same folders.
#
# usage: make-keys.sh HOST...        names by which the coordinators and their proxy are reached
set -euo pipefail
umask 027
readonly done_mark=/keys/client/token

[ ! -s "$done_mark" ] || exit 0

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

hosts=()
for host in "$@"; do hosts+=(--host "$host"); done
metrofarm certs "$work/certs" "${hosts[@]}" >/dev/null

# token ROLE USER: prints the token and appends its line to the file of tokens.
token() {
  local lines
  mapfile -t lines < <(metrofarm token "$1" "$2" 2>/dev/null)
  echo "${lines[1]}" >>"$work/tokens"
  echo "${lines[0]}"
}
token admin owner >"$work/token"
token read prometheus >"$work/metrics-token"
head -c 32 /dev/urandom >"$work/session.key"

cd "$work/certs"
install -m 0640 ca.crt server.crt server.key "$work/tokens" "$work/session.key" /keys/coordinator
install -m 0640 ca.crt worker.crt worker.key /keys/worker
cat server.crt server.key >"$work/server.pem"
install -m 0640 "$work/server.pem" /keys/proxy
install -m 0640 "$work/metrics-token" /keys/prometheus/token
install -m 0640 ca.crt /keys/client
# Last: an interrupted run is repeated.
install -m 0640 "$work/token" "$done_mark"
