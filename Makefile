# `make demo` and `make test` need nothing but Python 3.11 or newer; they make .venv once and reuse it.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
# Written after a successful install, so an interrupted one is done again.
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.installed-docs

# More options for the demo, such as DEMO="--num-scenes 100 --optimization.epochs 1".
DEMO ?=

.PHONY: demo test lint format notebooks docs clean

demo: $(STAMP)
	$(BIN)/python scripts/demo.py $(DEMO)

test: $(STAMP)
	$(BIN)/pytest -n 2 --dist worksteal

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tests/run_mypy.py
	$(BIN)/codespell

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Executes the notebooks that have changed, each in up to ten minutes; `make docs` shows them with their results then.
notebooks: $(patsubst %.ipynb,build/%.ipynb,$(wildcard notebooks/*.ipynb))

build/notebooks/%.ipynb: notebooks/%.ipynb | $(STAMP)
	$(BIN)/python notebooks/run.py $< --out build/notebooks

# Warnings are errors. API pages are written anew: autosummary keeps those of modules that are gone.
docs: $(DOCS_STAMP)
	rm -rf docs/api
	$(BIN)/sphinx-build --quiet --fail-on-warning --jobs 2 -c docs . build/docs

$(DOCS_STAMP): $(STAMP)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[docs]"
	touch $(DOCS_STAMP)

# torch goes first and alone: asked for together with packages that depend on it, pip may look at newer builds.
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt torch
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	touch $(STAMP)

clean:
	rm -rf $(VENV) build docs/api *.egg-info runs cache
