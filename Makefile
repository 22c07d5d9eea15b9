# `make` sets everything up and runs the main job; `make test` sets up and tests.
PYTHON ?= python3.11
VENV := .venv
FASTAC := $(VENV)/bin/fastac
SCENE ?= paper
READY := $(VENV)/.ready
SYNTH := $(VENV)/.synth

.PHONY: all build test unit lint bench synth clean
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
	$(VENV)/bin/python -m fastac.benchmark build/$(SCENE)

# The synthesis tools are an extra of their own: 250 MB that only this target needs.
$(SYNTH): $(READY)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[synth]'
	touch $@

synth: $(SYNTH)
	$(FASTAC) synth build/$(SCENE)

clean:
	rm -rf build
