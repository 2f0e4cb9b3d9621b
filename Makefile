# make demo: the whole cell, simulated.  make test: lint, then types, the daily tests, and what the
# wheel holds at once, of which the tests in real time come first.
# make webcam: you in front of your camera, the forecast and a moving robot, in 3D.
# make test-long: the tests marked `long`, every property with 100 examples (EXAMPLES), and the wheel
# installed alone.
# make test-random: every property with 1000 examples (EXAMPLES), others in each run.
# make test-ros2: the source and the link against real ROS 2 nodes in other processes.
# make bundle: a folder that installs the node without internet, build/bundle (EXTRAS=accel,fleet).
# make docs: the site of all pages, into build/site.
# make pictures: the pictures of pages in docs/, by a real browser (Debian's chromium).
# make elsewhere: programs of others read a recording (npm fetches them, 200 MB, build/elsewhere).
# Each makes its own .venv; PIP_FLAGS goes to pip (an index with the CPU build of torch, say);
# JOBS is how many tests run at once: a number, or all the machine's cores.
PYTHON ?= python3
PIP_FLAGS ?=
JOBS ?= logical
EXTRAS ?= accel
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) -c constraints.txt
WHEEL_VENV := build/wheel-venv
ROS2_VENV := build/ros2-venv

# Tests start many processes: these need not compile the same modules again and again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo webcam test test-long test-random test-ros2 lint types pytest pytest-long wheel wheel-alone bundle bench docs pictures elsewhere clean

demo: $(VENV)/.run
	$(BIN)/hri-predict demo

webcam: $(VENV)/.webcam
	$(BIN)/hri-predict try

test: lint
	$(MAKE) --no-print-directory -j 3 types wheel pytest
	@echo "all checks passed"

test-long: $(VENV)/.dev
	$(MAKE) --no-print-directory -j 2 pytest-long wheel-alone
	@echo "all long checks passed"

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	nice -n 19 $(BIN)/mypy

pytest: $(VENV)/.dev
	$(BIN)/python -m tests.together daily $(JOBS)

pytest-long: $(VENV)/.dev
	$(BIN)/python -m tests.together long $(JOBS)

test-random: $(VENV)/.dev
	EXAMPLES=$${EXAMPLES:-1000} RANDOM_EXAMPLES=1 \
		$(BIN)/python -m pytest -m "hypothesis and not realtime" -n $(JOBS)

# The wheel's files, with the packages of .venv but without the working tree's, check the demo's
# configuration from an empty folder.
wheel: $(VENV)/.dev
	rm -rf build/dist build/unpacked build/empty
	nice -n 19 $(BIN)/python -m build --wheel --no-isolation --outdir build/dist .
	$(BIN)/python -m zipfile -e build/dist/*.whl build/unpacked
	mkdir -p build/empty
	cd build/empty && PYTHONPATH=../unpacked ../../$(BIN)/python -c "import hri_predict as p, \
		hri_drivers as d, hri_sim as s; assert all('unpacked' in m.__file__ for m in (p, d, s))"
	cd build/empty && PYTHONPATH=../unpacked ../../$(BIN)/python -m hri_predict check demo.yaml

# The wheel, built from the source distribution and installed alone, runs the demo's configuration
# from an empty folder.
wheel-alone: $(VENV)/.dev
	rm -rf build/dist $(WHEEL_VENV) build/empty
	nice -n 19 $(BIN)/python -m build --outdir build/dist .
	nice -n 19 $(PYTHON) -m venv $(WHEEL_VENV)
	nice -n 19 $(WHEEL_VENV)/bin/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) \
		-c constraints.txt build/dist/*.whl
	mkdir -p build/empty
	cd build/empty && nice -n 19 ../wheel-venv/bin/hri-predict check demo.yaml
	cd build/empty && nice -n 19 ../wheel-venv/bin/hri-predict demo --speed max

# They wait more than they compute, each in a ROS domain of its own: four at a time. What fails then,
# for want of a processor or by the middleware (which once crashed while a node ended), fails if it
# fails alone too.
ROS2_TESTS := tests/hri_drivers/links/ros2 tests/hri_drivers/sources/ros2 \
	tests/hri_drivers/wires/test_ros2.py tests/hri_sim/fault_table/test_ros2_link.py \
	tests/hri_sim/bench/test_ports.py
test-ros2: $(ROS2_VENV)/.done
	$(ROS2_VENV)/bin/python -m pytest -n 4 --dist worksteal $(ROS2_TESTS) || \
		$(ROS2_VENV)/bin/python -m pytest --last-failed $(ROS2_TESTS)

bundle: $(VENV)/.dev
	rm -rf build/dist build/bundle
	$(BIN)/python -m build --wheel --outdir build/dist .
	$(BIN)/python deploy/bundle.py build/dist build/bundle --extras "$(EXTRAS)" $(PIP_FLAGS)

bench: $(VENV)/.run
	$(BIN)/hri-predict bench

pictures: $(VENV)/.dev
	mkdir -p build/pictures
	$(BIN)/hri-predict demo --speed max --record build/pictures/demo.mcap --overwrite
	$(BIN)/hri-predict explain build/pictures/demo.mcap --at 7.1 --picture docs/guides/why.png
	cd build/pictures && ../../$(BIN)/hri-predict report demo.mcap --out shift.html
	cd build/pictures && chromium --headless --no-sandbox --disable-gpu --hide-scrollbars \
		--window-size=1000,2300 --screenshot=../../docs/guides/shift.png shift.html
	$(BIN)/python -m tests.pictures docs

elsewhere: $(VENV)/.dev
	mkdir -p build/elsewhere
	cp tests/elsewhere/package.json build/elsewhere
	cd build/elsewhere && npm install --ignore-scripts --no-audit --no-fund
	$(BIN)/python -m pytest -m long -rs tests/elsewhere
	$(BIN)/hri-predict demo --speed max --record build/elsewhere/demo.mcap --overwrite
	$(BIN)/python -m tests.elsewhere.studio build/elsewhere/demo.mcap \
		docs/foxglove.png

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[accel]'
	touch $@

$(VENV)/.webcam: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[camera,viewer,accel]'
	touch $@ $(VENV)/.run

$(VENV)/.docs: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[docs]'
	touch $@

$(VENV)/.dev: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[dev]'
	touch $@ $(VENV)/.run $(VENV)/.docs $(VENV)/.webcam

# ROS 2 brings another package named lark than the tests': an environment beside .venv, which adds
# .venv's packages.
$(ROS2_VENV)/.done: $(VENV)/.dev
	rm -rf $(ROS2_VENV)
	$(PYTHON) -m venv $(ROS2_VENV)
	$(BIN)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))" \
		> $$($(ROS2_VENV)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/dev.pth
	$(ROS2_VENV)/bin/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) \
		-c constraints.txt -e '.[ros2]'
	touch $@

clean:
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache .hypothesis
