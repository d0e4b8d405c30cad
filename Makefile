# Needs only Python >= 3.11 and make. Everything is installed into .venv, and nothing outside it.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEMO := fig5b_state_b
N ?= 10000
SEED ?= 2026

.PHONY: help venv demo test check bench fuzz

help:
	@echo "make demo    run scenarios/$(DEMO).toml, write its CSV files and its picture"
	@echo "make test    run the tests"
	@echo "make check   lint, check format, types and the import rules"
	@echo "make bench   measure the speed against SciPy"
	@echo "make fuzz    play N=$(N) random scenarios of SEED=$(SEED) against the closed form; docs/fuzz.json"
	@echo "make venv    create or update the environment in $(VENV)"

venv: $(INSTALLED)

demo: $(INSTALLED)
	@$(BIN)/balloons run scenarios/$(DEMO).toml --plot --out results/$(DEMO)
	@echo
	@echo "The tables:   results/$(DEMO)/history.csv and results/$(DEMO)/events.csv"
	@echo "The picture:  results/$(DEMO)/history.png"

test: $(INSTALLED)
	$(BIN)/python -m pytest

check: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(INSTALLED)
	$(BIN)/python -m pytest benchmarks --benchmark-only
	$(BIN)/python -m pytest benchmarks -k "memory or reach or cpu" -s

fuzz: $(INSTALLED)
	$(BIN)/python -m tests.fuzz $(N) --seed $(SEED) --keep results/fuzz --report docs/fuzz.json

# The mark is made last, so that an interrupted installation is done again.
$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python >= 3.11 is needed, \
	$(PYTHON) is %d.%d. Name another one: make PYTHON=python3.12 ..." % sys.version_info[:2])'
	@test -x $(BIN)/python || { echo "Creating $(VENV) ..."; $(PYTHON) -m venv $(VENV); }
	@echo "Installing dielectric-balloons and its tools into $(VENV) (a minute or two, once) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@
