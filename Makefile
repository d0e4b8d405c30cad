# Needs only Python >= 3.11 and make. Everything is installed into .venv, and nothing outside it;
# `make lowest` and `make pythons` make environments of their own beside it.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DOCS := $(VENV)/.installed-docs
SITE := docs/_build/html
DEMO := fig5b_state_b
N ?= 10000
SEED ?= 2026
# Where `make fuzz` leaves its counts.
REPORT ?= docs/fuzz.json
# What pytest runs: `make test TESTS="tests/test_trace.py -x"`. Two processes take half the time.
TESTS ?=
WORKERS ?= 2
# Further options of a study or of the benchmarks: `make accuracy OPTIONS="--repeat 1 --out results"`.
OPTIONS ?=

.PHONY: help venv demo test browser format check coverage lowest pythons bench fuzz fuzz-whole fuzz-lockstep fuzz-states accuracy stress paper figures docs release

help:
	@echo "make demo      run scenarios/$(DEMO).toml, write its CSV files and its picture"
	@echo "make test      run the tests"
	@echo "make browser   look at the page of balloons live in Chromium"
	@echo "make check     lint, check format, types and the import rules"
	@echo "make format    mend lint and format where that is safe"
	@echo "make coverage  run the tests, and say which lines they do not reach"
	@echo "make lowest    run the tests with the oldest releases that pyproject.toml allows"
	@echo "make pythons   run the tests on every supported Python of this machine"
	@echo "make bench     measure the speed against SciPy"
	@echo "make fuzz      play N=$(N) random scenarios of SEED=$(SEED) against the closed form; $(REPORT)"
	@echo "make fuzz-whole  play N=$(N) random scenarios of the whole grammar against independent references"
	@echo "make fuzz-lockstep  play N=$(N) random sweeps of 40 runs in lockstep and one by one"
	@echo "make fuzz-states  hold graphs of states of N=$(N) random devices against five histories of each"
	@echo "make accuracy  measure error against run time; docs/accuracy.md"
	@echo "make stress    play stiff and extreme scenarios, and runs made to go wrong; docs/stability.md"
	@echo "make paper     compare with every number of the paper; docs/paper.md"
	@echo "make figures   draw the figures of the paper; docs/figures"
	@echo "make docs      run every code block of the docs, draw the gallery, build the site; $(SITE)/index.html"
	@echo "make release   build what would be published, and try it from the wheel alone; dist/"
	@echo "make venv      create or update the environment in $(VENV)"

venv: $(INSTALLED)

demo: $(INSTALLED)
	@$(BIN)/balloons run scenarios/$(DEMO).toml --plot --out results/$(DEMO)
	@echo
	@echo "The tables:   results/$(DEMO)/history.csv and results/$(DEMO)/events.csv"
	@echo "The picture:  results/$(DEMO)/history.png"

test: $(INSTALLED)
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal $(TESTS)

browser: $(INSTALLED)
	$(BIN)/python -m pytest $(or $(TESTS),tests/browser)

format: $(INSTALLED)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

check: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: $(INSTALLED)
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal --cov --cov-report=term-missing $(TESTS)

lowest pythons: $(INSTALLED)
	$(BIN)/python -m tests.environments $@ --numprocesses $(WORKERS) --dist worksteal $(TESTS)

# The second line is what does not time one function, and prints or asserts instead.
bench: $(INSTALLED)
	$(BIN)/python -m pytest tests/benchmarks -k "not (memory or reach or cpu or paint)" $(or $(OPTIONS),--benchmark-enable)
	$(BIN)/python -m pytest tests/benchmarks -k "memory or reach or cpu or paint" -s

fuzz: $(INSTALLED)
	$(BIN)/python -m tests.fuzz $(N) --seed $(SEED) --keep results/fuzz --report $(REPORT)

fuzz-whole: $(INSTALLED)
	$(BIN)/python -m tests.fuzz.whole $(N) --seed $(SEED) --keep results/fuzz-whole --report docs/fuzz-whole.json

fuzz-lockstep: $(INSTALLED)
	$(BIN)/python -m tests.fuzz.lockstep $(N) --seed $(SEED) --keep results/fuzz-lockstep

fuzz-states: $(INSTALLED)
	$(BIN)/python -m tests.fuzz.states $(N) --seed $(SEED) --keep results/fuzz-states

accuracy stress paper figures: $(INSTALLED)
	$(BIN)/python -m tests.studies.$@ $(OPTIONS)

# First every code block is run. -n: a name that leads nowhere is a warning; -W: every warning is an error.
docs: $(INSTALLED_DOCS)
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal tests/pages
	@rm -rf docs/reference/api docs/gallery/drawn
	$(BIN)/python -m sphinx -W -n --keep-going -q -E -b html docs $(SITE)
	@echo "The site: $(SITE)/index.html"

# Nothing is uploaded: that is `twine upload dist/*`, by hand.
release: $(INSTALLED)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,release]"
	$(BIN)/python -m tests.release $(OPTIONS)

$(INSTALLED_DOCS): $(INSTALLED)
	@echo "Installing what the site is built with ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,docs]"
	@touch $@

# The mark is made last, so that an interrupted installation is done again.
$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python >= 3.11 is needed, \
	$(PYTHON) is %d.%d. Name another one: make PYTHON=python3.12 ..." % sys.version_info[:2])'
	@test -x $(BIN)/python || { echo "Creating $(VENV) ..."; $(PYTHON) -m venv $(VENV); }
	@echo "Installing dielectric-balloons and its tools into $(VENV) (a minute or two, once) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@
