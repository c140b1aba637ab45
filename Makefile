# The two commands that matter: `make run` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# The tests start hundreds of processes: compiled once is enough for all of them.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help run test test-full lint bench ci-packages clean

help:            ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/ -/'

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "mvp-cell needs Python 3.11 or newer; found $$($(PYTHON) --version). Set PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $(STAMP)

run: $(STAMP)    ## plan, capture and verify on the virtual cell
	$(BIN)/mvp-cell run virtual --yes

lint: $(STAMP)   ## ruff, mypy strict, layer check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Four at a time on two cores: a third of their time the tests wait for wires.
test: lint       ## lint and the test suite (under 15 minutes on 2 cores)
	$(BIN)/pytest -n 4 --dist worksteal -q

test-full: lint  ## the large counts as well
	HYPOTHESIS_PROFILE=new-inputs $(BIN)/pytest -n 3 --dist worksteal -q -m 'not hardware'

bench: $(STAMP)  ## side-by-side timings, ratios printed
	$(BIN)/python tools/bench_planner.py

ci-packages: $(STAMP)  ## Debian packages for the tests of GenICam cameras, as root
	bash tools/install_ci_packages.sh $(BIN)/python

clean:           ## remove the environment and caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
