.DEFAULT_GOAL := help
.PHONY: help run test test-all fast cluster fingertip fingertip-data fingertip-coarse benchmark benchmark-solver benchmark-indentation benchmark-hidden benchmark-warp benchmark-faults setup lint clean

PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin

help:  ## show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 24

run: setup  ## set up and identify the phantom study
	$(BIN)/snakemake --cores $(CORES)

# a module's tests stay in one process, so that what they share is made once; tests/conftest.py puts long modules first
# one thread of linear algebra for each of the processes, which are as many as the cores; another number if it is given
TEST = OMP_NUM_THREADS=$${OMP_NUM_THREADS:-1} $(BIN)/python -m pytest -n $(WORKERS) --dist loadscope --no-loadscope-reorder -rs --durations=25
WORKERS = $(CORES)

test: setup  ## set up and run the tests but the slow ones: 12 to 15 minutes on two cores
	$(TEST) -m 'not slow'

# one process more than cores: the tests of the cluster wait most of the time
test-all: WORKERS = $(shell expr $(CORES) + 1)
test-all: setup  ## set up and run all tests: 20 to 40 minutes on two cores
	$(TEST)

FINGERTIP := studies/fingertip
fingertip-data: $(FINGERTIP)/subject.inp  ## make the volumes of the virtual fingertip and its mesh: 5 minutes

$(FINGERTIP)/study.yaml: .venv/ready $(FINGERTIP)/experiment.yaml $(FINGERTIP)/anatomy.yaml
	$(BIN)/fingerfit finger --anatomy $(FINGERTIP)/anatomy.yaml --size 1.7 --out $(FINGERTIP)/sealed/true.inp
	$(BIN)/fingerfit experiment $(FINGERTIP)/experiment.yaml --out $(FINGERTIP) --force

$(FINGERTIP)/subject.inp: $(FINGERTIP)/study.yaml
	$(BIN)/fingerfit finger --out $(FINGERTIP)/reference.inp
	$(BIN)/fingerfit morph $(FINGERTIP)/reference.inp $(FINGERTIP)/pictures/before.nii.gz --at 25.49 0 --out $@

COARSE := studies/fingertip-coarse
fingertip-coarse: fingertip-data  ## a mesh of the virtual fingertip that CalculiX can take
	$(BIN)/fingerfit finger --element C3D4 --size 3 --out $(COARSE)/reference.inp
	$(BIN)/fingerfit morph $(COARSE)/reference.inp $(FINGERTIP)/pictures/before.nii.gz --at 25.49 0 --out $(COARSE)/subject.inp

fast: .venv/fast  ## install PARDISO (650 MB): large systems in space in a fraction of the time

.venv/fast: .venv/ready requirements-fast.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-fast.lock
	touch $@

cluster: .venv/cluster  ## install what runs studies on SLURM (docs/cluster.md)

.venv/cluster: .venv/ready requirements-cluster.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-cluster.lock
	touch $@

fingertip: fast fingertip-data  ## identify both tissues of the virtual fingertip: 4 minutes
	$(BIN)/snakemake --cores $(CORES) --configfile $(FINGERTIP)/config.yaml

benchmark: setup  ## make phantom.md, noise.md and least_squares.md again: about an hour, needs ccx
	$(BIN)/python benchmarks/phantom.py
	$(BIN)/python benchmarks/noise.py
	$(BIN)/python benchmarks/least_squares.py

setup: .venv/ready  ## make the virtual environment in .venv from the lock file

.venv/ready: requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "fingerfit needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

benchmark-solver: setup  ## the built-in solver against CalculiX: benchmarks/solver.md (4 minutes)
	$(BIN)/python benchmarks/solver.py

benchmark-indentation: setup  ## the same in space, a sphere into a finger: benchmarks/indentation.md (half an hour)
	$(BIN)/python benchmarks/indentation.py

benchmark-warp: setup  ## volumes warped and scored: benchmarks/warp.md (one minute)
	$(BIN)/python benchmarks/warp.py

benchmark-hidden: setup  ## hidden effects, found or not: benchmarks/hidden_effects.md (two hours)
	$(BIN)/python benchmarks/hidden_effects.py

benchmark-faults: setup  ## all bad inputs and faults: benchmarks/faults.md (20 minutes)
	FINGERFIT_TEST_EVERYTHING=1 FINGERFIT_FAULTS=benchmarks/faults.md $(BIN)/python -m pytest tests/faults -m slow -n $(CORES)

lint: setup  ## style, types, rules
	$(BIN)/ruff check . && $(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint

clean:  ## remove results, not the environment
	rm -rf results .snakemake
