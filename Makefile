# make run: the paper's sensor, simulated and solved.  make test: all checks.
# make reproduce: the paper's figures, tables and claims.  make docs: the documentation, in site/.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: run test lint types layers unit bench reproduce docs clean

run: .venv/installed
	$(BIN)/facets simulate paper -o results/paper --force

test: lint types layers unit

lint: .venv/developed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/developed
	$(BIN)/mypy

layers: .venv/developed
	$(BIN)/lint-imports

unit: .venv/developed
	$(BIN)/pytest

bench: .venv/installed
	$(BIN)/facets bench -o results/bench --force

reproduce: .venv/installed
	$(BIN)/facets reproduce $(QUICK) -o results/reproduce --force

docs: .venv/developed
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --upgrade "pip>=23.1"
	$(BIN)/pip install --quiet --editable .
	touch $@

.venv/developed: .venv/installed
	$(BIN)/pip install --quiet --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv build results site *.egg-info
