# `make` sets everything up and runs the main job; `make test` sets up and tests.
PYTHON ?= python3.11
VENV := .venv
FASTAC := $(VENV)/bin/fastac
SCENE ?= paper
READY := $(VENV)/.ready

.PHONY: all build test unit lint bench clean
.DELETE_ON_ERROR:

all: build

# The environment is complete or is made again: the stamp comes last.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	touch $@

build: $(READY)
	$(FASTAC) build scenes/$(SCENE).toml

test: lint unit

lint: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

unit: $(READY)
	$(VENV)/bin/python -m pytest -n auto

bench: $(READY)
	$(VENV)/bin/python -m sim.bench_speed

clean:
	rm -rf build
