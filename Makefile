# make setup | test | lint | train | sweep | clean; PYTHON=python3.12 chooses the interpreter.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
export NO_ALBUMENTATIONS_UPDATE = 1

.PHONY: setup test lint train sweep demo drive bench clean

setup: $(READY)

# From the project's files alone, and only when they changed.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev]"
	@touch $@
	@echo "set up in .venv; next: make train ARGS=\"data.root=FOLDER\""

test: $(READY)
	$(BIN)/python -m pytest $(ARGS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# make train ARGS="experiment=tiny41 data.root=FOLDER"
train: $(READY)
	$(BIN)/python -m zoo $(ARGS)

# make sweep ARGS="model=lenet,nvidia data.root=FOLDER"
sweep: $(READY)
	$(BIN)/python -m zoo -m $(ARGS)

demo:
	@echo "make demo: not built yet, it needs the embedded simulator; make train trains on your own recording" >&2; exit 2

drive:
	@echo "make drive: not built yet; python -m zoo leaves checkpoints that it will drive" >&2; exit 2

bench:
	@echo "make bench: not built yet; python -m zoo prints samples per second of each run" >&2; exit 2

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
