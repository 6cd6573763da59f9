PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup demo test test-wire test-work lint bench study mutants attack docs thesis friction

# How long `make study` goes on drawing campaigns.
MINUTES ?= 60

setup: .venv/ready

.venv/ready: requirements.lock pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m compileall -q isorig
	$(BIN)/python -m isorig.rig.virtual.compile_kernels
	touch $@

demo: setup
	$(BIN)/rig demo -o demo-out

# The tests, on two cores: those of instruments, sessions and screens wait most of the time, so many of their files run side by side
# next to the others, and before them: they keep time. One that fails is run once more, on its own: a computer that is busy with
# something else may have been late. A file is run by one process (its tests may follow from each other), those of `conftest.py`
# first.
WIRE := tests/drivers tests/rig/acquire tests/rig/view
PYTEST := $(BIN)/python -m pytest -q -m "not study" --dist loadfile --no-loadscope-reorder

test: setup
	@$(MAKE) --jobs=2 --output-sync=target test-wire test-work

# Two processes on two cores: threads of the linear algebra library in each of them would wait for each other.
test-wire test-work: export OPENBLAS_NUM_THREADS = 1

# Compiled tests are kept, also where the environment forbids it: else each of the processes compiles them again.
test-wire test-work: export PYTHONDONTWRITEBYTECODE =

test-wire: setup
	$(PYTEST) -n 4 $(WIRE) || $(PYTEST) -n 0 --last-failed --last-failed-no-failures none $(WIRE)

test-work: setup
	nice -n 19 $(PYTEST) -n 2 $(WIRE:%=--ignore=%)

# Speed and accuracy beside peers in one run, which writes docs/bench.md. `make bench QUICK=--quick` takes fewer repeats.
bench: .venv/bench
	$(BIN)/python bench/run.py $(QUICK)

.venv/bench: .venv/ready bench/requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r bench/requirements.lock -c requirements.lock
	touch $@

# The long tests, and the rates of the diagnosis: goes on where the last one ended, for docs/study.md.
study: setup
	$(BIN)/python -m pytest -q -m study
	$(BIN)/python tests/blind/study.py --minutes $(MINUTES)
	$(BIN)/python tests/blind/foreign/diagnosed.py --seeds 2662-2991 --minutes $(MINUTES) --csv docs/study/foreign.csv
	$(BIN)/python tests/blind/cause_coverage.py --minutes $(MINUTES)
	$(BIN)/python tests/blind/tally.py

# Which changes of the scoring and decision code the tests notice: about a quarter of an hour; survivors are listed in docs/mutants.md.
mutants: setup
	$(BIN)/python tests/mutation/run_mutants.py --named
	$(BIN)/python tests/mutation/run_mutants.py

# Attacks by chance on the acquisition and all commands, over all cores: writes docs/attack.md. An interrupted run goes on where it
# ended, as long as build/attack.jsonl is there. The long runs are asked for: `make attack SOAK=3600 FLEET_HOURS=24` on a machine
# that does nothing else.
IMAGES ?= 2000
FAULTS ?= 500
INPUTS ?= 2000
SEED ?= 1
SOAK ?= 0
FLEET_HOURS ?= 0

attack: setup
	mkdir -p build
	$(BIN)/python tests/attack/run_attack.py --images $(IMAGES) --faults $(FAULTS) --inputs $(INPUTS) --seed $(SEED) \
		--soak $(SOAK) --fleet-hours $(FLEET_HOURS) --results build/attack.jsonl --page docs/attack.md

# The documentation site, warnings as errors.
docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The pictures of the page on friction: docs/pictures/friction-*.
friction: setup
	$(BIN)/python -m thesis.friction docs

# The thesis's figures and tables: docs/thesis.md and docs/pictures/thesis-* from a virtual campaign, and friction-*.
thesis: setup
	$(BIN)/python -m thesis.friction docs
	$(BIN)/python -m thesis docs

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
