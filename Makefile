# make demo, make test: each needs only Python (3.11 or newer) and a Rust toolchain, and makes what is missing.

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
TOOLS  := $(VENV)/.tools
DEV    := $(VENV)/.dev
BUILT  := $(VENV)/.built
RUST   := $(shell find core/src binding/src -name '*.rs' 2>/dev/null) Cargo.toml Cargo.lock core/Cargo.toml binding/Cargo.toml

.PHONY: demo test build lint test-rust test-python bench pictures format clean

demo: $(BUILT)
	$(BIN)/armonic demo

test: lint test-rust test-python

build: $(BUILT)

$(TOOLS):
	@command -v cargo >/dev/null || { echo "error: no Rust toolchain found (cargo); install one, 1.89 or newer"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "error: Python 3.11 or newer is needed; name one with PYTHON=..."; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1' 'maturin>=1.9,<2'
	touch $@

$(BUILT): $(TOOLS) $(RUST) pyproject.toml
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --quiet
	touch $@

$(DEV): $(BUILT) pyproject.toml
	$(BIN)/python -m pip install --quiet --group dev
	touch $@

lint: $(DEV)
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	MYPYPATH=python $(BIN)/python -m mypy.stubtest armonic._core

test-rust:
	cargo test --workspace --quiet

# Files of tests share the cores; threads of the BLAS beside them would only wait for each other.
test-python: export OPENBLAS_NUM_THREADS = 1
test-python: $(DEV)
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

bench: $(DEV)
	cargo bench -p armonic-core
	for b in frf_against_numpy update_against_numpy lscf_against_sdypy startup survey_against_pinocchio survey_grid survey_cost; do \
		$(BIN)/python benches/$$b.py || exit 1; done

pictures: $(BUILT)
	$(BIN)/python docs/pictures.py

format: $(DEV)
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf target demo $(VENV)
