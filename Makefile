# Everything a person does here, by name. `make help` lists it.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
WARM := $(VENV)/.warm
PAGES := api/static/index.html
SITE := api/site/index.html
DISTRIBUTIONS := $(patsubst %/pyproject.toml,%,$(sort $(wildcard distributions/*/pyproject.toml)))
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests start some hundred processes: what they load is compiled once, also where the environment says that nothing compiled is kept.
export PYTHONDONTWRITEBYTECODE :=

# What a goal needs is made two at a time (kernels beside pages, checks beside the tests of the pages); several goals in their order.
ifeq ($(words $(MAKECMDGOALS)),1)
MAKEFLAGS += --jobs=2
endif

.DEFAULT_GOAL := help
.PHONY: help setup wheels image release demo demo-lab serve test check quick web web-dev web-test screenshots format proof faults fuzz bench bench-coverage bench-cluster bench-client bench-service bench-web bench-optimizers openapi stub catalogue docs tutorials figures lock clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | while IFS="$$(printf '\t')" read -r name what; do printf '  make %-16s %s\n' "$$name" "$$what"; done

# The stamp is newer than what it depends on exactly when the environment is complete: a second `make` installs nothing.
$(INSTALLED): requirements.lock pyproject.toml $(addsuffix /pyproject.toml,$(DISTRIBUTIONS))
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info[:2] < (3, 11) and "Python 3.11 or newer is needed, $(PYTHON) is " + sys.version.split()[0])'
	@test -x $(BIN)/python || "$(PYTHON)" -m venv $(VENV) || { echo 'No virtual environment: on Debian, apt install python3.11-venv'; exit 1; }
	@echo 'Installing the locked, hashed versions of requirements.lock into $(VENV) (minutes the first time) ...'
	@$(BIN)/python -m pip install -qq --require-hashes --only-binary :all: -r requirements.lock
	@$(BIN)/python -m pip install -qq --no-deps --no-build-isolation $(addprefix --editable ./,$(DISTRIBUTIONS))
	@touch $@

$(WARM): $(INSTALLED)
	@echo 'Compiling the kernels (a minute or two, once for a machine) ...'
	@{ $(BIN)/python -m engine.batch.linear.warm && $(BIN)/python -m engine.batch.sampled_data.warm; } & $(BIN)/python -m engine.batch.kernels.warm && wait $$!
	@touch $@

# npm writes that file when it has installed what the lock says.
web/node_modules/.package-lock.json: web/package-lock.json | $(INSTALLED)
	@echo 'Installing what the browser client is made of into web/node_modules ...'
	@web/npm ci --no-audit --no-fund --loglevel=error
	@touch $@

$(PAGES): web/node_modules/.package-lock.json openapi/openapi.json $(shell find web -path web/node_modules -prune -o -type f -not -name schema.d.ts -print) $(wildcard examples/systems/*.json)
	@echo 'Building the browser client into api/static ...'
	@web/npm run build --silent -- --logLevel warn

# Links, anchors and references that lead nowhere end it. The old site goes first: pages that are no more would stay in it.
$(SITE): $(INSTALLED) zensical.toml $(shell find docs servotune -type f -not -name '*.pyc')
	@echo 'Building the documentation into api/site ...'
	@rm -rf api/site && NO_COLOR=1 $(BIN)/python -m zensical build --clean --strict > .site.log 2>&1 || { cat .site.log; rm -rf api/site; exit 1; }
	@rm -f .site.log

setup: $(INSTALLED) $(WARM) $(PAGES) $(SITE)  ## install everything into .venv, from locked versions, and build the browser client and the documentation

docs: $(SITE)  ## build the documentation into api/site, which the service serves at /docs

web: $(PAGES)  ## build the browser client into api/static

web-dev: $(PAGES)  ## the browser client with hot reload on http://127.0.0.1:5173, beside a running `make serve`
	@web/npm run dev

web-test: $(PAGES)  ## types, lint and unit tests of the browser client
	@web/npm run --silent lint
	@web/npm run --silent test

screenshots: setup  ## write docs/screenshots/ from the pages, with a service of their own
	@$(BIN)/python -m tests.browser.screenshots

# Wheels are for those who have no copy of the repository: servotune, servotune-server with the pages, servotune-agent.
wheels: setup  ## build the three distributions into dist/
	@for each in $(DISTRIBUTIONS); do (cd $$each && $(CURDIR)/$(BIN)/python -m hatchling build --target wheel --directory $(CURDIR)/dist) || exit 1; done

image: setup  ## build the image of the service (podman or docker), see that it has all that it uses, keep it in dist/
	@$(BIN)/python distributions/image.py

release: wheels $(if $(or $(shell command -v podman),$(shell command -v docker)),image)  ## the wheels and, where podman or docker is installed, the image in dist/ with its bill of materials, the licences of its parts, and sums, signed where KEY names an SSH key
	@$(BIN)/python distributions/release.py $(KEY)

demo: setup  ## measurement to proven optimum on a real recording, over HTTP; writes demo-report.html
	@$(BIN)/python -m examples.demo

demo-lab: setup  ## a day in the lab on a simulated rig, NI's or a PLC's (DRIVER=opcua): measure, identify, re-optimise, measure again; writes demo-lab.png
	@$(BIN)/python -m examples.demo_lab $(if $(DRIVER),--driver $(DRIVER))

serve: setup  ## start the service on http://127.0.0.1:8000 with one worker beside it
	@$(BIN)/servotune serve

# Files begin in the order of their names: browsers and databases first, and many short unit tests fill up the end. Without the
# last option the files with the fewest tests would be the last, and those take the longest: one core would wait for the other.
# One process more than there are cores, because many tests wait: for a browser, a job, a beat of a heart.
test: check web-test  ## every check and every test
	@$(BIN)/pytest -q -n $$(( $$(getconf _NPROCESSORS_ONLN) + 1 )) --dist loadfile --no-loadscope-reorder --durations 30

check: setup  ## format, lint, types and import contracts
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/ruff check --quiet .
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/lint-imports --no-logo

# SINCE=origin/main looks at a whole branch. Without a test that the change reaches, formatting, lint and types are all there is.
quick: setup  ## format, lint, types, and the tests that import what changed since the last commit (under three minutes)
	@$(BIN)/ruff format --quiet . && $(BIN)/ruff check --fix --quiet .
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/lint-imports --no-logo > /dev/null || $(BIN)/lint-imports --no-logo
	@tests=$$($(BIN)/python -m tests.affected $(or $(SINCE),HEAD)) && test -z "$$tests" || $(BIN)/pytest -q -x -n $$(getconf _NPROCESSORS_ONLN) $$tests

format: setup  ## let ruff put the code into form
	@$(BIN)/ruff format --quiet .
	@$(BIN)/ruff check --fix --quiet .

# Some 7,000 s of processor time, half of it the compiled kernels beside the exact path: a process on each core, sharing single
# tests. What records half an hour wants the machine for itself.
proof: setup  ## the random-system properties at full size (an hour on two cores, then recordings of half an hour each; `make test` runs them small)
	@$(BIN)/pytest -q tests/property tests/reference --hypothesis-profile=proof -n $$(getconf _NPROCESSORS_ONLN) --dist worksteal
	@$(BIN)/pytest -q tests/integration/agent/test_memory.py tests/integration/faults/test_long_recordings.py --hypothesis-profile=proof

faults: setup  ## killed workers and services, a database that goes away or fills up, load; longer than in `make test`
	@SERVOTUNE_FAULTS=full $(BIN)/pytest -q tests/integration/faults tests/integration/storage/test_jobs_recovery.py

fuzz: setup  ## random requests made from the contract on both databases, and files of every format with random damage (long)
	@$(BIN)/pytest -q tests/integration/api/test_fuzzing.py tests/property/test_damaged_files.py --hypothesis-profile=proof -n $$(getconf _NPROCESSORS_ONLN) --dist worksteal

# One thread for everybody, and memory that is kept between calls: batched numpy is at its best so.
bench: setup  ## this engine beside its peers: time, ratio and accuracy (minutes)
	@OPENBLAS_NUM_THREADS=1 MALLOC_MMAP_THRESHOLD_=1000000000 MALLOC_TRIM_THRESHOLD_=1000000000 $(BIN)/python -m bench $(if $(MARKDOWN),--markdown)

bench-coverage: setup  ## what a candidate costs for every metric under every command, and with every law, beside python-control and scipy (minutes)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -W ignore -m bench.coverage

bench-service: setup  ## rates of the queue, what a second worker brings, 200 clients for a minute (minutes)
	@$(BIN)/python -m bench.service

bench-cluster: setup  ## what a chunk costs on its way through a cluster, and what eight workers bring (a minute)
	@$(BIN)/python -m bench.spreading

bench-client: setup  ## the client's wheel, its installation with and without a cache, its import (a minute)
	@$(BIN)/python -m bench.client

bench-web: setup  ## from a moving slider to the painted picture, a diagram of 300 blocks, ten million samples, in a real Chromium (minutes)
	@$(BIN)/python -m bench.drag
	@$(BIN)/python -m bench.diagram
	@$(BIN)/python -m bench.recording

bench-optimizers: setup  ## every published optimum by every method that covers it; writes docs/benchmarks/ (minutes)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m bench.optimizers

openapi: setup  ## write openapi/openapi.json from the code
	@mkdir -p openapi && $(BIN)/servotune openapi > openapi/.new && mv openapi/.new openapi/openapi.json

stub: setup  ## write servotune/asynchronous.pyi from the client
	@$(BIN)/python -m tests.support.stub

catalogue: setup  ## write docs/catalogue/ from the code, and docs/reference/cli.md and docs/deploy/ from the commands
	@$(BIN)/python docs/catalogue/generate.py
	@$(BIN)/python docs/reference/generate.py

tutorials: setup  ## write docs/tutorials/ from the notebooks of the examples, with what they print and draw (minutes)
	@$(BIN)/python docs/tutorials/generate.py

figures: setup  ## write docs/figures/ from the examples, with a service of their own (a minute or two)
	@$(BIN)/python -m examples.figures

# Our own distributions need one another: they are told where they are, and left out of the locks. What the image runs is a part of the whole lock.
LOCKED := --python-version 3.11 --generate-hashes --quiet --no-emit-package servotune --no-emit-index-url --no-emit-find-links --custom-compile-command 'make lock'
lock: setup  ## resolve the newest versions that our declarations allow into requirements.lock, and of them what the image runs into requirements-image.lock
	@$(BIN)/uv pip compile $(addsuffix /pyproject.toml,$(DISTRIBUTIONS)) --all-extras --group demo --group bench --group docs --group dev \
		--upgrade $(LOCKED) --output-file requirements.lock
	@$(BIN)/uv pip compile $(addsuffix /pyproject.toml,distributions/servotune distributions/servotune-server) \
		$(addprefix --extra ,cluster convex formats interop objects pareto telemetry) --constraint requirements.lock $(LOCKED) --output-file requirements-image.lock

clean:  ## remove the environment, caches and what the demo wrote
	@rm -rf $(VENV) api/site .cache dist .demo .demo-lab demo-report.html demo-lab.png .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
