# `make` lists the targets. Each makes or refreshes its own .venv and needs nothing but python3 with venv and pip.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.made-from-pyproject
# one thread for BLAS: the arrays are small, and the tests themselves use all cores
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help reproduce reference smoke bench test survive fuzz lint clean

help: ## list the targets
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## (.*)/  make \1\t\2/' | expand -t 18

reproduce: $(STAMP) ## run all experiments as the papers did, check their claims, write results/ and the report
	$(BIN)/rkfbench reproduce

reference: $(STAMP) ## the same and more at the reference run counts, into results/reference/
	$(BIN)/rkfbench reproduce --reference

smoke: $(STAMP) ## every command on every scenario with few runs; the wheel in a clean environment
	BIN=$(BIN) PYTHON=$(PYTHON) ./.ci/smoke

bench: $(STAMP) ## what a run and step costs, beside other libraries and C, into results/bench/ (installs the peers)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	$(BIN)/python -m rkfbench.bench

test: $(STAMP) ## the test suite
	$(BIN)/pytest -q -n 2

survive: $(STAMP) ## kill, interrupt, starve and damage studies, and let them go on
	$(BIN)/pytest -q -m "slow or not slow" tests/survive

fuzz: $(STAMP) ## read thousands of broken and hostile scenario files, other ones each time
	FUZZ=nightly $(BIN)/pytest -q -n 2 -m "slow or not slow" tests/fuzz

lint: $(STAMP) ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

clean: ## remove the environment, the caches and what the experiments wrote, but not results/reference
	rm -rf .venv build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	find results -mindepth 1 -maxdepth 1 ! -name reference -exec rm -rf {} + 2>/dev/null || true

$(STAMP): pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@
