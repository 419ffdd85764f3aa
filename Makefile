# make demo   installs into .venv and runs the main job on the sample
# make test   installs and passes the tests
# make bench  prints the benchmarks (slow)
# make fuzz   gives mutated files to every reader (slow); what it finds goes into tests/fuzz/corpus
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 \
	&& { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
THREADS := OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1

.PHONY: demo test bench fuzz lint install clean

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "make: no Python 3.11 or later with venv found; type: sudo apt-get install python3.11 python3.11-venv"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/.installed: pyproject.toml setup.py | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml setup.py | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[dev,consumers]"
	@touch $@ $(VENV)/.installed

install: $(VENV)/.installed
	$(BIN)/massprops doctor

demo: $(VENV)/.installed
	$(BIN)/massprops reconstruct samples/spacecraft.mp4 -o runs/demo --scale $$(cat samples/spacecraft.length)
	$(BIN)/massprops compare runs/demo samples/spacecraft.stl -o runs/demo

test: $(VENV)/.installed-dev
	$(THREADS) $(BIN)/python -m pytest -q -n 2 --dist loadfile -m "not bench"

bench: $(VENV)/.installed-dev
	$(THREADS) $(BIN)/python -m pytest -q -s -m bench

fuzz: $(VENV)/.installed-dev
	$(THREADS) nice -n 10 $(BIN)/python -m tests.fuzz --inputs 20000

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check massprops cli tests
	$(BIN)/ruff format --check massprops cli tests
	$(BIN)/mypy

clean:
	rm -rf $(VENV) runs build *.egg-info
