# Everything a developer or a user runs by hand. Tools live in .tools (tests/setup/setup.sh).

export PATH := $(CURDIR)/.tools/bin:$(CURDIR)/.tools/python/bin:$(CURDIR)/.tools/go:$(PATH)
# The pinned toolchain, never one that go fetches on its own.
export GOTOOLCHAIN := local
export METROFARM_TOOLS := $(CURDIR)/.tools/go
# What one checkout compiled another need not: paths count from its root.
export CMAKE_CXX_COMPILER_LAUNCHER := ccache
export CCACHE_BASEDIR := $(CURDIR)
export CCACHE_NOHASHDIR := 1

PYTHON := $(CURDIR)/.tools/python/bin/python
SETUP := tests/setup/setup.sh
BENCH_ARGS ?=
RATE_ARGS ?=
REPORT_ARGS ?=
LOAD_ARGS ?=
FARM_COST_ARGS ?=
CHAOS_ARGS ?=
# Names of patches in tests/sabotage; empty: all.
SABOTAGE ?=

.DEFAULT_GOAL := help
.PHONY: help build worker worker-tests services web demo test agreement references bench farm-cost report sabotage \
        stress chaos load cluster cluster-down format lint sanitize setup setup-test setup-bench clean

help: ## show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 14

build: worker services ## install what is missing, compile bin/metrofarm and bin/metrofarm-worker

demo: build ## render the door-ajar scene through the REST interface
	@tests/setup/demo.sh

test: ## all checks: lint, unit, end-to-end, image agreement, sanitizers
	@tests/run.sh

agreement: build ## image agreement with Mitsuba 3, long form (hours)
	$(PYTHON) -m pytest -q tests/agreement --long

bench: build setup-test setup-bench ## run time against error, and rates, beside Mitsuba 3
	.tools/bench/bin/python tests/bench/bench.py $(RATE_ARGS)
	.tools/python/bin/python tests/bench/efficiency.py $(BENCH_ARGS)

farm-cost: build setup-test ## service overhead, checkpoints, scaling from one worker to two
	.tools/python/bin/python tests/bench/farm_cost.py $(FARM_COST_ARGS)

report: build setup-test setup-bench ## widths of kernels, rates of convergence, what laziness saves
	.tools/python/bin/python tests/bench/report.py $(REPORT_ARGS)

chaos: build setup-test ## kill 50 processes at random and disturb deliveries; writes tests/chaos/doc
	$(PYTHON) -m pytest -q -s tests/chaos --kills 50 --pause 5.5 --record tests/chaos/doc/run $(CHAOS_ARGS)

load: build setup-test ## hundreds of simulated workers on one coordinator: where it saturates
	PYTHONPATH=tests/e2e $(PYTHON) tests/load/load.py $(LOAD_ARGS)

sabotage: build setup-test ## plant bugs, one at a time; each must turn a test red
	$(PYTHON) tests/sabotage/sabotage.py $(SABOTAGE)

format: setup-test ## format all sources
	@tests/setup/lint.sh format

lint: setup-test ## format checks and linters
	@tests/setup/lint.sh all

sanitize: setup-test ## the worker's unit tests under the address and undefined sanitizers
	@tests/setup/sanitize.sh

references: setup-bench ## render the reference images of the agreement tests again (Mitsuba 3)
	.tools/bench/bin/python tests/agreement/make_references.py
	.tools/bench/bin/python tests/agreement/make_motion_references.py

web: setup ## build the dashboard; its output is committed under services/internal/api/web
	cd web && npm ci --no-audit --no-fund && cp package-lock.json node_modules/.installed-lock.json && npm run build

clean: ## remove everything built; .tools stays
	rm -rf build bin demo

worker: setup
	@mkdir -p build bin
	@cmake -S worker -B build/worker -G Ninja -DCMAKE_BUILD_TYPE=Release >build/configure.log 2>&1 \
	  || { cat build/configure.log; exit 1; }
	cmake --build build/worker --target metrofarm-worker
	cp build/worker/app/metrofarm-worker bin/metrofarm-worker.new
	mv bin/metrofarm-worker.new bin/metrofarm-worker

worker-tests: worker
	cmake --build build/worker

services: setup
	@mkdir -p bin
	cd services && go build -o ../bin/metrofarm ./cmd/metrofarm

setup:
	@$(SETUP) build

setup-test:
	@$(SETUP) test

setup-bench:
	@$(SETUP) bench

cluster: ## start the compose cluster and render a scene on it by curl (needs docker)
	@deploy/compose/cluster.sh demo

cluster-down: ## stop the compose cluster; what it holds stays
	@deploy/compose/cluster.sh down

stress:
	@echo "make $@ comes with a later version" >&2; exit 1
