# Two commands on a fresh machine: `make push` and `make test`.
# ARGS goes to what is run: make push ARGS="--direction inward --hold"

PYTHON ?= python3
BIN := .venv/bin
PIP_INSTALL := $(BIN)/python -m pip install --only-binary :all: --editable

# Matrices here are small: threads inside BLAS cost more than they save.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: push test lint browser results clean

push: .venv/installed
	$(BIN)/python scripts/push.py $(ARGS)

test: lint browser
	$(BIN)/pytest -n 2 --dist worksteal $(ARGS)

lint: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The system's Chromium, or apt-get's, or else playwright's own download.
# What drives it is a Node.js that misses libatomic on a bare Debian.
browser: .venv/installed-test
	@$(BIN)/playwright --version || sh .ci/apt libatomic1
	@command -v chromium || command -v google-chrome || sh .ci/apt chromium \
		|| $(BIN)/playwright install chromium

# Remakes the results and pictures of docs from this commit: the sweep begins
# below the limits that are there, and goes on after an interruption.
results: .venv/installed-test browser
	mkdir -p build
	test -e build/known || mv docs/results/fig10 build/known
	$(BIN)/python scripts/envelope.py --replicas 3 --from build/known \
		--out docs/results/fig10
	$(BIN)/python scripts/push.py --out build/push
	$(BIN)/python docs/figures/picture.py --run build/push --gif \
		--width 440 --height 620 --out docs/push.gif
	$(BIN)/python scripts/simulate.py --scenario_name cinder_blocks \
		--out build/blocks
	$(BIN)/python docs/figures/picture.py --run build/blocks \
		--times 5.9 10.5 16.3 --azimuth 60 --elevation 18 --distance 4.6 \
		--width 270 --height 300 --out docs/ground.png
	$(BIN)/python docs/figures/reference.py
	rm -r build/known

clean:
	rm -rf .venv build dist *.egg-info

# Drake's wheel brings its libraries along, all but GLib.
.venv/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "nadia_balance needs Python 3.11 or newer: make PYTHON=..."; \
		exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP_INSTALL) .
	$(BIN)/python -c 'import pydrake.common' || sh .ci/apt libglib2.0-0
	@touch $@

.venv/installed-test: .venv/installed
	$(PIP_INSTALL) '.[test]'
	@touch $@
