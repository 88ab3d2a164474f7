# Two commands: `make demo` runs a whole session on the simulated rig, `make test` runs every check that needs no
# machine of its own. `make test-devices` runs the drivers on real kernel drivers, in virtual machines.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DEMO_SESSION ?= runs/demo
SITE := build/site

.PHONY: demo test test-devices lint docs check-tools clean

demo: $(READY)
	$(BIN)/rig run $(DEMO_SESSION) -p hw_profiles/sim-room.toml

# Compiled first, for whom Python keeps nothing that it compiled: each of the tests' processes would compile all anew.
test: $(READY) lint docs
	$(BIN)/python -m compileall -q calibration rig sim
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-devices: $(READY)
	$(BIN)/python tests/device_lab/run.py $(SUITES)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --config-file benchmarks/mypy.ini
	$(BIN)/lint-imports

# The site of docs/ and of the docstrings: warnings are errors; ends by printing the path of its start page.
docs: $(VENV)/.docs-ready
	rm -rf $(SITE)
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --jobs auto --conf-dir docs . $(SITE)
	$(BIN)/python docs/site/check.py $(SITE)

$(VENV)/.docs-ready: $(READY)
	$(BIN)/python -m pip install --quiet --group docs
	@touch $@

check-tools:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	  || { echo "missing: Python 3.11 or newer (Debian, Ubuntu: apt-get install python3 python3-venv python3-dev)" >&2; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null \
	  || { echo "missing: Python's venv module (Debian, Ubuntu: apt-get install python3-venv)" >&2; exit 2; }
	@command -v $${CXX:-c++} >/dev/null \
	  || { echo "missing: a C++ compiler (Debian, Ubuntu: apt-get install g++)" >&2; exit 2; }

$(READY): pyproject.toml CMakeLists.txt $(wildcard native/*.?pp $(foreach p,sim calibration,$(p)/kernel/*.?pp $(p)/kernel/*/*.?pp)) | check-tools
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --editable . --group dev
	@touch $(READY)

clean:
	rm -rf $(VENV) build runs
