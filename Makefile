# PYTHON=python3.12 chooses the interpreter.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
export NO_ALBUMENTATIONS_UPDATE = 1
# Where it is set, as in many containers, each process of the tests compiles every module again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup test test-all matrix lint docs docs-links train sweep demo drive bench dist clean

help: ## list these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s%s\n", $$1, $$2 }' Makefile

setup: $(READY) ## install everything in .venv

# Runs again only if one of the project's files changed.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	@echo "downloading and installing in .venv; torch is the largest package, and takes minutes"
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e ".[dev]"
	@touch $@
	@echo "installed in .venv; next: make demo, or make train ARGS=\"data.root=FOLDER\""

demo: $(READY) ## record the embedded lake, train on it, drive it; print the files that it wrote
	$(BIN)/drivezoo demo

train: $(READY) ## train: make train ARGS="experiment=tiny41 data.root=FOLDER"
	$(BIN)/drivezoo train $(ARGS)

sweep: $(READY) ## train a sweep: make sweep ARGS="model=lenet,nvidia data.root=FOLDER"
	$(BIN)/drivezoo train -m $(ARGS)

drive: $(READY) ## drive: make drive CKPT=FILE [SIM=lake] [ARGS="drive.speed.set_mph=15"]
	@test -n "$(CKPT)" || { echo "make drive: name a checkpoint, CKPT=outputs/.../checkpoints/best.ckpt" >&2; exit 2; }
	$(BIN)/drivezoo drive "$(CKPT)" $(if $(SIM),drive.sim=$(SIM)) $(ARGS)

test: $(READY) ## run the tests in two processes, and name the ten slowest; ARGS="-n 4" starts four
	$(BIN)/python -m pytest -n 2 --dist loadfile --durations=10 -m "not slow" $(ARGS)

test-all: $(READY) ## run the slow tests, too
	$(BIN)/python -m pytest -n 2 --dist loadfile --durations=10 $(ARGS)

matrix: ## try each Python from 3.10 to 3.13 that is found: make matrix ARGS="3.13 tests=false"
	$(PYTHON) .ci/matrix.py $(ARGS)

lint: $(READY) ## check style, imports, types and spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy
	.ci/check-platforms
	$(BIN)/codespell conf datamodules docs drivezoo tests zoo benchmarks *.md

bench: $(READY) ## print timings, and what they are compared with: make bench [ONLY=feed,start]
	$(BIN)/python benchmarks/bench.py $(if $(ONLY),ONLY=$(ONLY)) $(ARGS)

docs: $(READY) ## build the manual, docs/_build/index.html, and check the links within it
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build

docs-links: $(READY) ## open the manual's links to other sites
	$(BIN)/sphinx-build -b linkcheck docs docs/_build/links

dist: $(READY) ## build the wheel, install it in a fresh environment, and train and drive with it
	rm -rf dist
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .
	.ci/try-wheel $(PYTHON)

clean: ## remove what was set up
	rm -rf .venv .matrix build dist docs/_build *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
