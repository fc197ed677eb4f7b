#!/usr/bin/env bash
# Renders the door-ajar scene through the REST interface of a coordinator of its own, then says
# where the results are. In a terminal the dashboard stays up until Ctrl-C.
#
# usage: demo.sh         DEMO_SECONDS (120) of rendering, dashboard at DEMO_LISTEN (a free port)
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly out=$PWD/demo seconds=${DEMO_SECONDS:-120}

free_port() {
  .tools/python/bin/python -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'
}

wait_until_ready() {
  local attempt
  for attempt in $(seq 100); do
    .tools/python/bin/python -c 'import sys, urllib.request; urllib.request.urlopen(sys.argv[1], timeout=2)' \
      "$1/readyz" 2>/dev/null && return 0
    kill -0 "$server" 2>/dev/null || break
    sleep 0.2
  done
  echo "the coordinator did not start (after $attempt attempts); its log:" >&2
  cat "$out/serve.log" >&2
  return 1
}

mkdir -p "$out"
listen=${DEMO_LISTEN:-127.0.0.1:$(free_port)}
farm_listen=127.0.0.1:$(free_port)
bin/metrofarm serve --listen "$listen" --farm-listen "$farm_listen" --data "$out/data" 2>"$out/serve.log" &
server=$!
trap 'kill "$server" 2>/dev/null; wait "$server" 2>/dev/null || true' EXIT
wait_until_ready "http://$listen"

echo "Rendering tests/scenes/door-ajar for $seconds s; watch it at http://$listen/"
job=$(bin/metrofarm submit tests/scenes/door-ajar/scene.xml --server "http://$listen" \
  --integrator pssmlt --time "$seconds" -o "$out/door-ajar.exr")
.tools/python/bin/python -c 'import sys, urllib.request; urllib.request.urlretrieve(sys.argv[1], sys.argv[2])' \
  "http://$listen/v1/jobs/$job/image.png" "$out/door-ajar.png"

cat <<END

EXR        $out/door-ajar.exr
PNG        $out/door-ajar.png
Dashboard  http://$listen/
END
if [ -t 1 ]; then
  echo "Ctrl-C ends the dashboard."
  trap 'exit 0' INT
  wait "$server"
else
  echo "The dashboard ends with this command. To see it again:"
  echo "  bin/metrofarm serve --data $out/data"
fi
