# Every target does its own set-up in a clean clone: Python 3.11 or newer, make and a network suffice.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROBOT ?= orthoglide

.PHONY: study test test-long oracles lint types install facts clean

study: $(VENV)/.view  ## report on one robot
	$(BIN)/gough study $(ROBOT) --out reports/$(ROBOT)

test: lint types  ## everything that has to pass before a change lands
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2

test-long: $(VENV)/.dev  ## many more random mechanisms and mutated files
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --hypothesis-profile=long

oracles: $(VENV)/.peers  ## models against Pinocchio and MuJoCo, which `make test` leaves out
	$(BIN)/pytest tests/oracles

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

install: $(VENV)/.dev  ## .venv with every extra

facts: $(VENV)/.dev  ## compute anew what `gough list` prints
	$(BIN)/python -m gough.catalogue_facts

$(VENV)/.python:
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'gough needs Python 3.11 or newer; name one with make PYTHON=...')"
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.view: pyproject.toml $(VENV)/.python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[view]"
	touch $@

$(VENV)/.dev: pyproject.toml $(VENV)/.python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@ $(VENV)/.view

$(VENV)/.peers: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,peers]"
	touch $@

clean:
	rm -rf $(VENV) build dist reports
