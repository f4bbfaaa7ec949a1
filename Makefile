# make run: the paper's sensor, simulated and solved.  make test: what each change needs.
# make check: everything, before a merge and a release.  make reproduce: the paper's figures, tables and
# claims.  make docs: the documentation, in site/.
PYTHON ?= python3
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)

# Python keeps byte code, also where a container's settings say that it should not: every process of the
# tests would compile all that it imports anew.
export PYTHONDONTWRITEBYTECODE :=

SHELL := bash
.SHELLFLAGS := -euo pipefail -c

.PHONY: run test check lint tree types layers quick unit studies portable installed lowest locked dist \
  publishable image bench reproduce docs gallery vendor clean

run: .venv/installed
	$(BIN)/facets simulate paper --folder results/paper --force

# Style, types, layers, and every promise of the README, the commands, Python and the formats, each by its
# cheapest case. The checks of the sources run beside the tests, which also wait.
test: .venv/developed
	$(MAKE) --no-print-directory -j2 quick checked-sources

# Everything, two at a time. The tests come first: some record in real time, which more beside them disturbs.
check: .venv/developed
	$(MAKE) --no-print-directory -j2 unit checked-sources
	$(MAKE) --no-print-directory -j2 installed lowest
	$(MAKE) --no-print-directory -j2 portable locked run reproduce docs QUICK=--quick

.PHONY: checked-sources
checked-sources: lint types layers

# Style, spelling, and what the hosts that publish the project expect of its files.
lint: .venv/developed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	git ls-files -z | xargs -0 $(BIN)/codespell
	git ls-files -z '*.md' | xargs -0 $(BIN)/rumdl check --silent
	$(BIN)/hadolint Dockerfile
	$(BIN)/zizmor --quiet --offline --persona pedantic .github
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-workflows .github/workflows/*
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.dependabot .github/dependabot.yml
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.citation-file-format CITATION.cff

# The package as it is installed, with cli/ and experiments/ inside, and the tests as packages, for tools
# that read sources.
tree:
	rm -rf build/tree && mkdir -p build/tree
	tar --exclude=__pycache__ -cf - facets tests | tar -xf - -C build/tree
	tar --exclude=__pycache__ -cf - cli experiments configs | tar -xf - -C build/tree/facets
	find build/tree/tests -type d -exec touch {}/__init__.py \;

types: .venv/developed tree
	MYPYPATH=build/tree $(BIN)/mypy -p facets | sed -E \
	  -e 's#^build/tree/facets/(cli|experiments)/#\1/#' -e 's#^build/tree/##'

layers: .venv/developed tree
	cd build/tree && COLUMNS=200 ../../$(BIN)/lint-imports --config ../../.importlinter --no-cache

# A file of tests stays in one process, so that what its tests share is made once; the order is that
# of tests/conftest.py.
PYTEST = $(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder
quick: .venv/developed
	$(PYTEST) -m "not study and not wheel and not plain and not slow"

unit: .venv/developed
	$(PYTEST)

# What takes minutes, and of which the suite has a shorter case.
studies: .venv/developed
	$(BIN)/pytest -n auto -m study

# What asserts on numbers, with machine code and linear algebra for the plainest processor: other
# instructions, another order of sums, other rounding.
portable: .venv/developed
	OPENBLAS_CORETYPE=Prescott FACETS_CPU=x86-64 FACETS_CACHE_DIR=build/portable \
	  $(BIN)/pytest -n auto --dist loadfile tests/optics/test_wedge.py tests/estimation/test_solver.py \
	  tests/characterization/test_singularity.py

# The package as others have it: the wheel, built and installed outside of this folder, with the newest
# versions of what it needs, and every command and the tests marked `installed` run there.
installed: .venv/developed
	$(BIN)/python tests/helpers/installed.py

# The same with the oldest versions that pyproject.toml allows.
lowest: .venv/developed
	$(BIN)/python tests/helpers/installed.py --lowest

# What contributors get by `uv sync`: the versions that uv.lock names.
locked: .venv/developed
	UV_PROJECT_ENVIRONMENT=build/locked $(BIN)/uv run --quiet --locked facets simulate paper --folder build/locked/paper --force

# The source distribution and the wheel as they are published, in dist/.
dist: .venv/developed
	$(BIN)/python tests/helpers/installed.py --only-build dist

# That nothing is left which only a maintainer can fill in, and that the tag is the version. The recipe
# needs the hash of what is on PyPI and the paper its authors: what they leave open stops no release.
TAG ?= v$(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' facets/core/version.py)
publishable:
	@git grep -nE 'OWNER|FILL IN' -- recipe paper || true
	@! git grep -nE 'OWNER[/.]|FILL IN' -- . ':!Makefile' ':!*.md' ':!tests' ':!recipe' ':!paper' \
	  || { echo 'fill in what these lines leave open'; exit 1; }
	@grep -qF '__version__ = "$(TAG:v%=%)"' facets/core/version.py \
	  || { echo 'the tag $(TAG) is not the version in facets/core/version.py'; exit 1; }

# The image that runs facets and the virtual bench.
image:
	docker build --tag facets .
	docker run --rm facets simulate paper --folder /tmp/paper

# What a target needs that `make run` does not: an extra of pyproject.toml.
EXTRA = $(BIN)/uv pip install --quiet --python $(BIN)/python "facets-6dof[$(1)]"
bench: .venv/installed
	$(call EXTRA,bench)
	$(BIN)/facets bench --folder results/bench --force

reproduce: .venv/installed
	$(call EXTRA,proof)
	$(BIN)/facets reproduce $(QUICK) --folder results/reproduce --force

docs: .venv/developed
	JUPYTER_CONFIG_PATH=docs/notebooks $(BIN)/properdocs build --strict --quiet

# The pictures of the documentation.
DRAW = $(BIN)/facets render docs/gallery/paper.yaml --force -o docs/gallery
TILTED = --at tx_mm=0.08,ty_mm=0.05,roll_mrad=8,pitch_mrad=6,yaw_mrad=10
SIZE = --width 1200 --height 750
gallery: .venv/developed
	$(DRAW)/rig.png $(TILTED) --style dark --width 1440 --height 900
	$(DRAW)/rig-light.png $(TILTED) --style paper $(SIZE)
	$(DRAW)/mirror.png $(TILTED) --view mirror --style dark $(SIZE)
	$(DRAW)/detector.png $(TILTED) --view detector --style dark $(SIZE)
	$(DRAW)/cutaway.png --view cutaway --style paper $(SIZE)
	$(DRAW)/range.png --view range --style dark $(SIZE)
	$(DRAW)/range-track.png --view range --track --style paper $(SIZE)
	$(DRAW)/trail.png --view trail --motion wander --style dark $(SIZE)
	$(DRAW)/wobble.gif --motion wobble --frames 40 --frame-rate 12.5 --style dark --width 600 --height 400
	$(DRAW)/spots.png $(TILTED) --spots
	$(DRAW)/plan.png --plan

# three.js and Papa Parse as the pages of rigs carry them, in the versions of vendor/package.json there.
vendor:
	rm -rf build/vendor && mkdir -p build && cp -R facets/pictures/page/vendor build/vendor
	cd build/vendor && npm install --no-audit --no-fund --no-package-lock --silent && npm run --silent build
	cp build/vendor/three.min.js build/vendor/node_modules/papaparse/papaparse.min.js facets/pictures/page/vendor/
	cd build/vendor/node_modules && for name in three papaparse; do \
		cp $$name/LICENSE $(CURDIR)/facets/pictures/page/vendor/$$name-LICENSE; done

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet uv
	$(BIN)/uv pip install --quiet --python $(BIN)/python --editable .
	touch $@

.venv/developed: .venv/installed
	$(BIN)/uv pip install --quiet --python $(BIN)/python --editable . --group dev
	touch $@

clean:
	rm -rf .venv build results site *.egg-info
