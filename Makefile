# One command each, from a fresh clone with make and Python 3.11 or newer. `make help` lists them.
SHELL := /bin/sh
.DEFAULT_GOAL := all
.DELETE_ON_ERROR:

VENV ?= .venv
BIN := $(VENV)/bin
# pytest workers
JOBS ?= 2

# Any Python of 3.11 or newer that can make a virtual environment; `make PYTHON=…` chooses another one.
USABLE := 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))'
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python3.14 python; do \
	$$p -c $(USABLE) >/dev/null 2>&1 && { echo $$p; break; }; done)

.PHONY: notebooks all course data install install-test lab test lint format types test-oldest reliability longrun audit bench render clean distclean help

all: course  ## everything: set up, fetch the Udacity set, run the pipeline on every set that is there

course: install data  ## calibrate and run on all pictures and videos -> output_images/, output_videos/
	$(BIN)/python -m lanelib course

data: install  ## fetch the Udacity set (88 MB, once); goes on without it where it cannot be had
	@$(BIN)/python -m lanelib fetch udacity || echo "make: going on without what could not be fetched"

install: $(VENV)/.installed  ## a virtual environment in .venv with lanelib and JupyterLab
install-test: $(VENV)/.installed-test

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "make: Python 3.11 or newer with venv is needed, none was found;" \
		"install it (Debian, Ubuntu: python3-venv) or name it: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	@$(PYTHON) -c $(USABLE) 2>/dev/null || { echo "make: Python 3.11 or newer with venv is needed," \
		"'$(PYTHON)' is not or cannot be run; name another one: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: requirements.txt pyproject.toml | $(VENV)/bin/python
	@echo "make: installing lanelib and JupyterLab into $(VENV) (about a minute)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.installed-test: requirements-dev.txt $(VENV)/.installed
	@echo "make: installing what the tests need into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

lab: install  ## open the course in JupyterLab
	$(BIN)/python -m jupyterlab notebooks $(if $(filter 0,$(shell id -u)),--allow-root)

test: lint  ## set up and run all tests: ruff, pytest, the notebooks
	$(BIN)/python -m pytest -n $(JOBS)
	@if ls notebooks/*.ipynb >/dev/null 2>&1; then $(MAKE) --no-print-directory test-notebooks; fi

# nbval compares the numbers that the notebooks discuss; notebooks/conftest.py gives them a tolerance.
# loadfile keeps one notebook on one worker, current-env ignores the kernel's saved name.
.PHONY: test-notebooks
test-notebooks: install-test  ## only the notebooks
	$(BIN)/python -m pytest notebooks --nbval -n $(JOBS) --dist loadfile --nbval-current-env \
		--nbval-cell-timeout=120 --nbval-sanitize-with=notebooks/nbval_sanitize.cfg

notebooks: install-test  ## build all notebooks from notebooks/source: run, store, learner's versions
	$(BIN)/python tools/notebooks.py build

lint: install-test  ## ruff over code and notebooks
	$(BIN)/ruff check .

format: install-test  ## sort imports and mend what ruff can mend
	$(BIN)/ruff check --fix .

types: install-test  ## mypy
	$(BIN)/mypy

# Its own environment, beside the usual one.
test-oldest:  ## the tests with the oldest supported versions (Python 3.11)
	$(MAKE) --no-print-directory VENV=.cache/oldest PIP_CONSTRAINT=constraints-oldest.txt test-pytest

.PHONY: test-pytest
test-pytest: install-test
	$(BIN)/python -m pytest -n $(JOBS)

reliability: install-test  ## bad input, faults, signals: writes docs/RELIABILITY.md (40 minutes; MINUTES=5 for a taste)
	$(BIN)/python tools/reliability.py $(if $(MINUTES),--minutes $(MINUTES))

longrun: install-test  ## a clip of two hours: its section of docs/RELIABILITY.md (half an hour)
	$(BIN)/python tools/reliability.py --long

# --strict: a package about which the database says nothing, or cannot be asked, is no clean one.
audit:  ## known vulnerabilities of the dependencies, by pip-audit (asks its advisory database on the network)
	@$(PYTHON) -c $(USABLE)
	$(PYTHON) -m venv .cache/audit
	.cache/audit/bin/python -m pip install --quiet --disable-pip-version-check pip-audit
	.cache/audit/bin/python -m pip_audit --strict --progress-spinner off -r requirements.txt

bench: install-test  ## measure the speed of every stage (not a test)
	@test -e benchmarks/run.py || { echo "make: there is no benchmarks/run.py in this checkout" >&2; exit 2; }
	$(BIN)/python benchmarks/run.py

# Rendering needs its own large packages, so it has its own environment.
render:  ## render again the shipped pictures whose scene changed (for developers; hours)
	$(PYTHON) -m venv .cache/render
	.cache/render/bin/python -m pip install --quiet --disable-pip-version-check -r render/requirements.txt
	.cache/render/bin/python -m render all

clean:  ## remove what was made: outputs of the fetched sets, caches (keeps .venv and fetched data)
	rm -rf output_images/udacity output_videos/udacity output_images/finding_lanes output_videos/finding_lanes
	rm -rf build *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis .coverage .benchmarks
	find lanelib tests -name __pycache__ -type d -prune -exec rm -rf {} +
	find camera_cal test_images test_videos output_images output_videos -name '*.part' -delete

distclean: clean  ## also remove the virtual environments and the fetched data
	rm -rf $(VENV) .cache camera_cal/udacity
	rm -rf test_images/udacity test_images/finding_lanes test_videos/udacity test_videos/finding_lanes

help:  ## this list
	@awk -F ':.*  ## ' '/^[a-z-]+:.*  ## / { printf "make %-15s%s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
