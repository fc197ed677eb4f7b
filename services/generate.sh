#!/usr/bin/env bash
# Regenerates gen/ from ../proto with pinned generators. Needs protoc (Debian: protobuf-compiler)
# and Go; the generators go to a tool directory inside the repository, never to GOPATH.
set -euo pipefail
cd "$(dirname "$0")"

readonly GEN_GO=google.golang.org/protobuf/cmd/protoc-gen-go@v1.36.12
readonly GEN_GRPC=google.golang.org/grpc/cmd/protoc-gen-go-grpc@v1.6.2
tools="${METROFARM_TOOLS:-$PWD/../.tools/go}"

mkdir -p "$tools"
GOBIN="$tools" go install "$GEN_GO"
GOBIN="$tools" go install "$GEN_GRPC"

rm -rf gen
mkdir gen
mapfile -t protos < <(cd ../proto && find metrofarm -name '*.proto' | sort)
PATH="$tools:$PATH" protoc --proto_path=../proto \
  --go_out=. --go_opt=module=metrofarm/services \
  --go-grpc_out=. --go-grpc_opt=module=metrofarm/services \
  "${protos[@]}"
