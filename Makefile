PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup demo test lint study

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

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
