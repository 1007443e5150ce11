# make demo | setup | test | test-all | lint | docs | docs-links | train | sweep | drive | clean; PYTHON=python3.12 chooses the interpreter.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
export NO_ALBUMENTATIONS_UPDATE = 1

.PHONY: setup test test-all lint docs docs-links train sweep demo drive bench clean

setup: $(READY)

# Runs again only if one of the project's files changed.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev]"
	@touch $@
	@echo "installed in .venv; next: make demo, or make train ARGS=\"data.root=FOLDER\""

# Two processes run the tests; ARGS="-n 4" starts four. Prints the ten slowest tests.
# test-all also runs the tests that are marked slow.
test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile --durations=10 -m "not slow" $(ARGS)

test-all: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile --durations=10 $(ARGS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy
	$(BIN)/codespell conf datamodules docs drivezoo simulator tests zoo benchmarks *.md

# The manual, docs/_build/index.html; links within it are checked. docs-links opens those to other sites.
docs: $(READY)
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build

docs-links: $(READY)
	$(BIN)/sphinx-build -b linkcheck docs docs/_build/links

# make train ARGS="experiment=tiny41 data.root=FOLDER"
train: $(READY)
	$(BIN)/python -m zoo $(ARGS)

# make sweep ARGS="model=lenet,nvidia data.root=FOLDER"
sweep: $(READY)
	$(BIN)/python -m zoo -m $(ARGS)

# Records the embedded lake, trains on it, drives it, and prints the files that it wrote.
demo: $(READY)
	$(BIN)/python -m zoo.demo

# make drive CKPT=outputs/.../best.ckpt [SIM=lake] [ARGS="drive.speed.set_mph=15"]
drive: $(READY)
	@test -n "$(CKPT)" || { echo "make drive: name a checkpoint, CKPT=outputs/.../checkpoints/best.ckpt" >&2; exit 2; }
	$(BIN)/python -m zoo.drive "$(CKPT)" $(if $(SIM),drive.sim=$(SIM)) $(ARGS)

# Prints timings and what they are compared with, in under five minutes: make bench [ONLY=feed,start]
bench: $(READY)
	$(BIN)/python benchmarks/bench.py $(if $(ONLY),ONLY=$(ONLY)) $(ARGS)

clean:
	rm -rf .venv build dist docs/_build *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
