.POSIX:

# PYTHON makes the virtual environment: any Python from 3.11 on.
PYTHON = python3
VENV = .venv
BIN = $(VENV)/bin
CASE = examples/mode1-small/case.yaml
ARGS =
INSTALL = $(BIN)/python -m pip install --quiet -c constraints.txt

.PHONY: all run test test-long test-cluster test-containers test-foreign soak fuzz verify-gimp verify-interface verify-monitors lint atomic-strain paper bench-overhead bench-bus bench-ranks bench-reports bench-gimp clean verify-sides conformance

all: run

run: $(VENV)/.run
	$(BIN)/gimpmd run $(CASE) $(ARGS)

test: $(VENV)/.dev
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder $(ARGS)

test-long: $(VENV)/.dev
	$(BIN)/python -m pytest -m long $(ARGS)

test-cluster: $(VENV)/.dev
	$(BIN)/python -m pytest -m cluster tests/cluster $(ARGS)

test-containers: $(VENV)/.dev
	$(BIN)/python -m pytest -m containers tests/containers $(ARGS)

test-foreign: $(VENV)/.dev
	$(BIN)/python -m pytest -m foreign tests/foreign $(ARGS)

soak: $(VENV)/.dev
	$(BIN)/python -m tests.soak $(ARGS)

fuzz: $(VENV)/.dev
	$(BIN)/python -m tests.fuzz $(ARGS)

verify-gimp: $(VENV)/.dev
	$(BIN)/python -m tests.physics.gimp $(ARGS)

verify-interface: $(VENV)/.dev
	$(BIN)/python -m tests.physics.interface $(ARGS)
	$(if $(ARGS),,$(BIN)/python -m tests.physics.interface.table)

verify-monitors: $(VENV)/.dev
	$(BIN)/python -m tests.monitors $(ARGS)

verify-sides: $(VENV)/.dev
	$(BIN)/python -m tests.physics.sides $(ARGS)

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

conformance: $(VENV)/.dev
	$(BIN)/python -m tests.conformance $(ARGS)

atomic-strain: $(VENV)/.dev
	cd examples/atomic-strain && ../../$(BIN)/python compare.py

paper: $(VENV)/.dev
	$(BIN)/python -m tests.paper $(ARGS)

bench-overhead: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks.overhead $(ARGS)

bench-bus: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks.bench_bus $(ARGS)

bench-ranks: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks.bench_ranks $(ARGS)

bench-reports: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks.bench_reports $(ARGS)

bench-gimp: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks.bench_gimp $(ARGS)

clean:
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis examples/foreign-service/target
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: each set of packages is installed once, and again when what it depends on changes.
$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "gimpmd needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "Name another one: make PYTHON=python3.12 ..." >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.run: $(VENV)/.made pyproject.toml constraints.txt
	$(INSTALL) -e '.[md,gimp,viz]'
	touch $@

$(VENV)/.dev: $(VENV)/.made pyproject.toml constraints.txt
	$(INSTALL) -e '.[dev]'
	touch $(VENV)/.run $@
