PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup demo test lint study docs thesis

setup: .venv/ready

.venv/ready: requirements.lock pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m rig.warm
	touch $@

demo: setup
	$(BIN)/rig demo -o demo-out

test: setup
	$(BIN)/python -m pytest -q -m "not study"

study: setup
	$(BIN)/python -m pytest -q -m study

# The documentation site, warnings as errors.
docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Tables and figures of the thesis from a virtual campaign: docs/thesis.md and docs/pictures/thesis-*.
thesis: setup
	$(BIN)/python -m rig.thesis docs

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
