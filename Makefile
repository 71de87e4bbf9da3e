# Needs only make and Python 3.10 or newer; everything else goes into .venv as ready-made wheels.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

BENCH := .venv-bench
BENCH_INSTALLED := $(BENCH)/.installed

.PHONY: demo test lint format bench bench-quick clean

demo: $(INSTALLED)
	$(BIN)/depthprint demo -o demo-run

test: $(INSTALLED)
	$(BIN)/python -m pytest -q -n 2 --dist loadfile

lint: $(INSTALLED)
	$(BIN)/ruff check src tests benchmarks tools examples
	$(BIN)/ruff format --check src tests benchmarks tools examples
	$(BIN)/mypy

format: $(INSTALLED)
	$(BIN)/ruff check --fix src tests benchmarks tools examples
	$(BIN)/ruff format src tests benchmarks tools examples

# Every comparison of BENCHMARKS.md, peers included, in an environment of its own.
bench: $(BENCH_INSTALLED)
	$(BENCH)/bin/python -m benchmarks

bench-quick: $(BENCH_INSTALLED)
	$(BENCH)/bin/python -m benchmarks --quick --out $(BENCH)/quick.json

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "depthprint needs Python 3.10 or newer: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --only-binary=:all: \
	  --constraint constraints.txt --editable '.[dev]'
	@touch $@

$(BENCH_INSTALLED): pyproject.toml constraints.txt benchmarks/peers.txt
	$(PYTHON) -m venv $(BENCH)
	@grep -vi '^numpy==\|^opencv-python-headless==' constraints.txt > $(BENCH)/constraints.txt
	@grep -v '^#' benchmarks/peers.txt | while read -r peer; do \
	  $(BENCH)/bin/python -m pip install --quiet --disable-pip-version-check --only-binary=:all: \
	    --constraint $(BENCH)/constraints.txt "$$peer" \
	    || echo "no ready-made wheel here, left out: $$peer"; \
	done
	$(BENCH)/bin/python -m pip install --quiet --disable-pip-version-check --only-binary=:all: \
	  --constraint $(BENCH)/constraints.txt --editable .
	@touch $@

clean:
	rm -rf $(VENV) $(BENCH) demo-run build .pytest_cache .mypy_cache .ruff_cache
