# Everything happens in .venv, made on first use. PYTHON picks the interpreter (>= 3.11).
PYTHON ?= python3
BIN = .venv/bin

demo: .venv/ready  ## set up and run the demo
	$(BIN)/rock2d demo

test: .venv/ready  ## set up and run the tests
	$(BIN)/python -m pytest

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# BEFORE names the file of an earlier run, to compare with; ONLY chooses benchmarks by their names, as -k of pytest does.
bench: .venv/bench  ## what a person waits for: a table, and every number in out/benchmarks.json
	mkdir -p out
	$(BIN)/python -m pytest -rs -o addopts= tests/benchmarks/bench_*.py --benchmark-json=out/benchmarks.json \
		$(if $(BEFORE),--benchmark-compare=$(BEFORE)) $(if $(ONLY),-k "$(ONLY)")

docs: .venv/docs  ## the documentation, into out/docs/index.html; a dead link fails
	$(BIN)/python docs/make_gallery.py --live
	$(BIN)/python -m mkdocs build

.venv/docs: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	touch $@

browser: .venv/browser  ## what the tests of pages in a browser need, beside Chromium

.venv/browser: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[browser]"
	touch $@

.venv/bench: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test]"
	touch $@

.PHONY: demo test lint docs bench browser
