# make demo: the whole cell, simulated.  make test: lint, types, tests, and the built wheel.
# Each makes its own .venv; PIP_FLAGS goes to pip (an index with the CPU build of torch, say);
# JOBS is how many tests run at once: a number, or all the machine's cores.
PYTHON ?= python3
PIP_FLAGS ?=
JOBS ?= logical
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) -c constraints.txt
WHEEL_VENV := build/wheel-venv

.PHONY: demo test lint types pytest wheel bench clean

demo: $(VENV)/.run
	$(BIN)/hri-predict demo

test: lint types pytest wheel
	@echo "all checks passed"

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

pytest: $(VENV)/.dev
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m "not realtime"
	$(BIN)/python -m pytest -m realtime

# The built wheel, installed alone, runs the demo's configuration from an empty folder.
wheel: $(VENV)/.dev
	rm -rf build/dist $(WHEEL_VENV) build/empty
	$(BIN)/python -m build --outdir build/dist .
	$(PYTHON) -m venv $(WHEEL_VENV)
	$(WHEEL_VENV)/bin/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) \
		-c constraints.txt build/dist/*.whl
	mkdir -p build/empty
	cd build/empty && ../wheel-venv/bin/hri-predict check demo.yaml
	cd build/empty && ../wheel-venv/bin/hri-predict demo --speed max

bench: $(VENV)/.run
	$(BIN)/hri-predict bench

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e .
	touch $@

$(VENV)/.dev: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[dev]'
	touch $@ $(VENV)/.run

clean:
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache .hypothesis
