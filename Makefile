# make demo, make test: each needs only Python (3.11 or newer) and a Rust toolchain, and makes what is missing.

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
DEPS   := $(VENV)/.dependencies
BUILT  := $(VENV)/.built
RUST   := $(shell find core/src binding/src -name '*.rs' 2>/dev/null) Cargo.toml Cargo.lock core/Cargo.toml binding/Cargo.toml
# Build with what is on the machine, never fetch a toolchain behind the user's back.
export RUSTUP_AUTO_INSTALL := 0

.PHONY: demo test build lint test-rust test-python bench pictures format clean

demo: build
	$(BIN)/armonic demo

test: lint test-rust test-python

build: $(BUILT)

$(DEPS): pyproject.toml
	@command -v cargo >/dev/null || { echo "error: no Rust toolchain found; install one with your package manager or rustup"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "error: Python 3.11 or newer is needed; name one with PYTHON=..."; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --quiet --group dev
	touch $@

$(BUILT): $(DEPS) $(RUST)
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --quiet
	touch $@

lint: build
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	MYPYPATH=python $(BIN)/python -m mypy.stubtest armonic._core

test-rust:
	cargo test --workspace --quiet

test-python: build
	$(BIN)/python -m pytest

bench: build
	cargo bench -p armonic-core
	for b in frf_against_numpy update_against_numpy startup; do $(BIN)/python benches/$$b.py || exit 1; done

pictures: build
	$(BIN)/python docs/pictures.py

format:
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf target demo $(VENV)
