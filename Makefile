# make demo   installs into .venv and runs the main job on the sample
# make test   installs and passes the tests
# make bench  prints the benchmarks (slow)
# make test-other-machine  passes the numerical tests as a plainer processor would compute them
# make test-without-pycolmap  passes the tests of all but `reconstruct`, for Linux on arm64
# make docs   builds the documentation into build/docs, with every link checked
# make gallery  runs the scripts of the gallery and makes their pictures; SHORT=1 runs a short form and keeps nothing
# make fuzz   gives mutated files to every reader (slow), then such as reach new lines where atheris can be installed; what
#             is found goes into tests/fuzz/corpus
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 \
	&& { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
THREADS := OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
# in the order of tests/conftest.py, the longest files first
PYTEST := $(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m "not bench"

.PHONY: demo test test-other-machine test-without-pycolmap bench fuzz lint docs gallery install clean

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "make: no Python 3.11 or later with venv found; type: sudo apt-get install python3.11 python3.11-venv"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/.installed: pyproject.toml setup.py | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e .
	@touch $@

# nerfbaselines reads Nerfstudio's data sets; what it asks for besides, an old numpy among it, is for training.
$(VENV)/.installed-dev: pyproject.toml setup.py | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[dev,consumers]"
	$(BIN)/python -m pip install --quiet --no-deps "nerfbaselines>=1.2"
	@touch $@ $(VENV)/.installed

install: $(VENV)/.installed
	$(BIN)/massprops doctor

demo: $(VENV)/.installed
	$(BIN)/massprops reconstruct samples/spacecraft.mp4 -o runs/demo --scale $$(cat samples/spacecraft.length)
	$(BIN)/massprops compare runs/demo samples/spacecraft.stl -o runs/demo

# What is compiled is kept, whatever the shell says: each process would else rewrite every test's assertions anew, 10 s of it.
test: $(VENV)/.installed-dev
	$(THREADS) PYTHONDONTWRITEBYTECODE= $(PYTEST)

# Kernels of BLAS, of numpy, of the compiled loops and of OpenCV that any processor has: other last bits than its own ones
# give. What a processor lacks can be turned off all the same; nothing is turned on.
PLAIN_BLAS := $(if $(filter x86_64 amd64,$(shell uname -m)),Nehalem,ARMV8)
OTHER_MACHINE := OPENBLAS_CORETYPE=$(PLAIN_BLAS) OPENCV_CPU_DISABLE=AVX512-SKX,AVX2,FP16 \
	NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=$(CURDIR)/$(VENV)/numba-generic
NUMPYS := from numpy._core._multiarray_umath import __cpu_dispatch__ as d, __cpu_features__ as f; print(*(x for x in d if f[x]))
NUMERICAL := tests/estimators/test_ekf.py tests/campaign/test_pesce2017.py tests/estimators/test_ukf.py tests/estimators/test_batch_step.py \
	tests/dense/test_dense.py tests/surface/test_surface.py

test-other-machine: $(VENV)/.installed-dev
	$(THREADS) $(OTHER_MACHINE) NPY_DISABLE_CPU_FEATURES="$$($(BIN)/python -c '$(NUMPYS)')" \
		$(PYTEST) $(NUMERICAL)

# What is tested where pycolmap cannot be installed (Linux on arm64).
WITHOUT_PYCOLMAP := tests/api tests/campaign tests/core tests/crosscheck tests/diagnose tests/diagnosis tests/docs tests/documents \
	tests/dynamics tests/estimators tests/exchange tests/mass tests/packaging tests/sequence tests/simulate tests/surface

test-without-pycolmap: $(VENV)/.installed-dev
	$(THREADS) $(PYTEST) $(WITHOUT_PYCOLMAP)

bench: $(VENV)/.installed-dev
	$(THREADS) $(BIN)/python -m pytest -q -s -m bench

$(VENV)/.installed-docs: pyproject.toml setup.py | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[docs]"
	@touch $@ $(VENV)/.installed

docs: $(VENV)/.installed-docs
	$(THREADS) $(BIN)/mkdocs build --quiet

gallery: $(VENV)/.installed-docs
	SHORT=$(SHORT) $(THREADS) $(BIN)/python docs/gallery $(ONLY)

fuzz: $(VENV)/.installed-dev
	-$(BIN)/python -m pip install --quiet "atheris>=3"
	$(THREADS) nice -n 10 $(BIN)/python -m tests.fuzz --inputs 20000
	$(THREADS) nice -n 10 $(BIN)/python -m tests.fuzz.guided --inputs 20000

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check massprops cli tests
	$(BIN)/ruff format --check massprops cli tests
	ln -sfn ../cli typings/massprops_cli  # the name by which it is imported
	$(BIN)/mypy
	$(BIN)/python -m tests.house
	$(BIN)/python -m pytest -q tests/core/test_import_graph.py

clean:
	rm -rf $(VENV) runs build *.egg-info
