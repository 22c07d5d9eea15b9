# `make` sets everything up and runs the main job; `make test` sets up and tests.
PYTHON ?= python3.11
VENV := .venv
FASTAC := $(VENV)/bin/fastac
SCENE ?= paper
READY := $(VENV)/.ready
SYNTH := $(VENV)/.synth
DOCS := $(VENV)/.docs
EVERYTHING := $(VENV)/.everything

.PHONY: all venv build test test-all mutants formal mutate simulators faults fuzz verification unit lint bench identities extremes \
	stability synth clocks verify verify-photographs trade seeds seeds-friction scope chips reproduce samples docs \
	docs-links lerobot notebooks clean
.DELETE_ON_ERROR:

all: build

# The environment is complete or is made again: the stamp comes last.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	touch $@

# Everything that commands need, and nothing built.
venv: $(READY)

build: $(READY)
	$(FASTAC) build scenes/$(SCENE).toml

# Every behaviour once; docs/testing.md says what only `make test-all` runs.
test: lint unit

PYTEST := $(VENV)/bin/python -m pytest -n auto --dist worksteal --durations 20

# What tests need that a build does not: the extras for views, logs, other formats, notebooks and the site.
$(EVERYTHING): $(READY)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[everything]'
	touch $@

unit: $(EVERYTHING)
	$(PYTEST) -m "not full"

test-all: lint $(EVERYTHING)
	$(PYTEST)

lint: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/lint-imports --cache-dir build/cache/imports

# Small faults put into the code one after another: which of them `make test` finds; see docs/testing.md.
mutants: $(READY)
	$(VENV)/bin/python tests/mutants.py

# Proofs with Yosys and z3; answers are kept in build/cache/formal.
formal: $(READY)
	$(FASTAC) prove formal

# Damaged files for every reader, thousands each; see docs/testing.md.
fuzz: $(READY)
	$(VENV)/bin/python tests/fuzz/campaign.py

# Mutants of every component of the hardware, which its own tests must find; kept in build/mutate.
mutate: $(READY)
	$(FASTAC) prove mutation

BENCHED = $(patsubst %/bundle/bundle.json,%,$(wildcard build/paper/bundle/bundle.json \
	build/fast/bundle/bundle.json build/force/bundle/bundle.json))

bench: $(READY)
	$(FASTAC) bench models $(BENCHED)
	$(FASTAC) bench stream $(BENCHED)

# The figures of docs/mathematics.md.
identities: $(READY)
	$(FASTAC) train scenes/fast.toml
	$(FASTAC) study identities build/fast

# The figures of docs/extremes.md; what has been simulated already is kept.
extremes: build
	$(FASTAC) study extremes build/$(SCENE)

# Thousands of frames through the emulator, and some through the whole simulated hardware.
stability: build
	$(FASTAC) study stability build/$(SCENE) --rtl-frames 100

# The synthesis tools are an extra of their own: 250 MB that only this target needs.
$(SYNTH): $(READY)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[synth]'
	touch $@

synth: $(SYNTH)
	$(FASTAC) synth scenes/$(SCENE).toml
	$(FASTAC) build scenes/$(SCENE).toml

# The clock of every module of SCENE, of the ten slowest from three placements each, on two trainings. Hours; what
# is found is kept.
clocks: $(SYNTH)
	$(FASTAC) synth scenes/$(SCENE).toml --placements 3
	$(FASTAC) train scenes/$(SCENE).toml --seed 2
	$(FASTAC) synth build/$(SCENE)-seed-2 --placements 3

# The campaign: both scenes at 1, 2 and 4 pixels a clock, half of the frames photographs of ball presses; and the
# scenes paper with a pixel in 4 clocks and small in 2 to 16.
PHOTOGRAPHS ?= ../shared/data/fots
PRESSES := build/photographs.h5

$(PRESSES): | $(READY)
	$(FASTAC) import ball-press $(PHOTOGRAPHS)/press --labels $(PHOTOGRAPHS)/press.csv \
		--background $(PHOTOGRAPHS)/background.png --ball-mm 4.70 --px-per-mm 19.58 -o $@

verify: $(READY)
	$(FASTAC) verify scenes/paper.toml
	$(FASTAC) verify scenes/paper.toml --lanes 1/4 --frames 1 -o build/paper/verify-folded
	$(FASTAC) verify scenes/small.toml --lanes 1/2,1/4,1/8,1/16 --frames 3
	@if [ -d "$(PHOTOGRAPHS)" ]; then \
		$(MAKE) verify-photographs; \
	else \
		echo "verify: no photographs in $(PHOTOGRAPHS); give their folder with PHOTOGRAPHS=FOLDER." \
			"Only simulated frames were verified."; \
	fi
	$(MAKE) simulators

verify-photographs: $(PRESSES)
	$(FASTAC) verify scenes/gelsight.toml --data $(PRESSES)

# The Verilog and netlists in Icarus Verilog (Debian's iverilog) and CXXRTL, of those scenes that are built: an hour.
simulators: $(READY)
	$(FASTAC) prove simulators $(if $(wildcard $(PHOTOGRAPHS)),--photographs $(PHOTOGRAPHS))

# What speed costs: every specification in sweeps/ but those of seeds, on all cores, then the page and its tables.
SWEEPS := $(filter-out sweeps/seeds%.toml,$(wildcard sweeps/*.toml))
RESULTS := $(patsubst sweeps/%.toml,build/sweep/%.sqlite,$(SWEEPS))

trade: $(READY)
	for spec in $(SWEEPS); do $(FASTAC) sweep $$spec || exit 1; done
	$(FASTAC) trade $(RESULTS)

# Each headline as mean and spread over ten trainings; what is trained is kept.
seeds: $(READY)
	$(FASTAC) sweep sweeps/seeds.toml
	$(FASTAC) trade build/sweep/seeds.sqlite -o build/seeds

# The same on the gel with friction: hours, and up to 8 GB of memory for each of two trainings side by side.
seeds-friction: $(READY)
	$(FASTAC) sweep sweeps/seeds-friction.toml --workers 2
	$(FASTAC) trade build/sweep/seeds-friction.sqlite -o build/seeds-friction

# Only what is required: a column for each scene, with the wall times of the builds that are there.
scope: $(READY)
	$(FASTAC) scope scenes/*.toml

# Which part holds which scene at which rate of the camera.
chips: $(READY)
	$(FASTAC) chips scenes/*.toml

# The paper's tables beside ours, into build/reproduce; `make reproduce SCENE=…` for another scene.
reproduce: override SCENE := $(if $(filter file,$(origin SCENE)),fingertip,$(SCENE))
reproduce: $(READY)
	$(FASTAC) reproduce scenes/$(SCENE).toml

# Ten thousand faults and misuses at the ports of small designs; what has passed is kept.
faults: $(READY)
	$(FASTAC) prove faults

# The package for LeRobot in an environment of its own, which has another torch (8 GB), beside `fastac serve`.
LEROBOT := build/lerobot-venv

$(LEROBOT)/.ready: integrations/lerobot/pyproject.toml
	$(PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install --quiet --disable-pip-version-check -e 'integrations/lerobot[test]'
	touch $@

lerobot: $(READY) $(LEROBOT)/.ready
	FASTAC=$(abspath $(FASTAC)) $(LEROBOT)/bin/python -m pytest integrations/lerobot

# Executed notebooks go to build/notebooks, their pictures to docs. These show simulated presses, whoever has photographs.
notebooks: $(EVERYTHING)
	PHOTOGRAPHS=simulated $(VENV)/bin/python notebooks/execute.py --pictures docs/images/notebooks

# The counts that the resource model is fitted to; hours of synthesis if the gateware has changed.
samples: $(SYNTH)
	$(VENV)/bin/python -m fastac.synth.estimates.resource_samples
	$(VENV)/bin/python -m fastac.synth.estimates.resource_samples folded

# The site of docs/ and the notebooks. Sphinx and its extensions are an extra of their own.
$(DOCS): $(READY)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	touch $@

docs: $(DOCS)
	$(VENV)/bin/python -m sphinx --fresh-env --fail-on-warning --quiet --builder html docs build/docs/html
	@echo build/docs/html/index.html

# Whether the pages' links to other sites still lead somewhere: needs the network.
docs-links: $(DOCS)
	$(VENV)/bin/python -m sphinx --fresh-env --quiet --builder linkcheck docs build/docs/links
	@echo build/docs/links/output.txt

clean:
	rm -rf build
