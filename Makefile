# GUARD: every target makes the virtual environment first when it is missing, and is quick when it is there.
PYTHON ?= python3.11
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
DEMO   := demo

.DEFAULT_GOAL := help
.PHONY: help install demo test slow check format bench clean

help: ## Print this help
	@echo "GUARD: one robot, one task, three simulators"
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | awk -F'\t' '{printf "  make %-9s %s\n", $$1, $$2}'

install: $(STAMP) ## Make .venv (Python 3.11) with everything in it

$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null 2>&1 || { echo "GUARD needs Python 3.11 (PyBullet has no newer wheels): '$(PYTHON)' was not found; install it or call make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { echo "GUARD needs Python 3.11 (PyBullet has no newer wheels), but '$(PYTHON)' is $$($(PYTHON) --version 2>&1); call make PYTHON=/path/to/python3.11"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing GUARD and its three simulators into $(VENV) ..."
	@$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt hatchling editables
	@$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt --no-build-isolation -e '.[dev]'
	@touch $(STAMP)

demo: $(STAMP) ## Train in MuJoCo, measure in MuJoCo, PyBullet and SAPIEN; writes demo/report.html
	@$(BIN)/guard transfer --env Goal_Point_8Hazards --algo cpo --cost-limit 2 --train-on mujoco \
		--backends mujoco bullet sapien --seeds 0 1 2 --total-steps 300000 --episodes 25 --out $(DEMO)

test: $(STAMP) ## Run the fast tests on every installed backend
	@$(BIN)/python -m pytest -n 2 --dist worksteal tests

slow: $(STAMP) ## Run the long checks too: learning, coverage of intervals, large sweeps, properties on many examples
	@$(BIN)/python -m pytest -m 'slow or hypothesis' --hypothesis-profile thorough tests

check: $(STAMP) ## Lint, format, types, and the import rule
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check -q .
	@$(BIN)/pyright
	@$(BIN)/python -m pytest tests/test_architecture.py

format: $(STAMP) ## Format the code
	@$(BIN)/ruff check --fix -q . ; $(BIN)/ruff format -q .

bench: $(STAMP) ## Benchmark and compare with the last saved run
	@$(BIN)/python -m pytest benchmarks --benchmark-only --benchmark-autosave --benchmark-storage=.benchmarks $(if $(wildcard .benchmarks/*/*.json),--benchmark-compare)

clean: ## Remove what make built
	rm -rf $(VENV) $(DEMO) .benchmarks .pytest_cache .ruff_cache
