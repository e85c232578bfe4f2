# Two commands on a fresh machine: `make push` and `make test`.
# ARGS goes to what is run: make push ARGS="--direction inward --hold"

PYTHON ?= python3
BIN := .venv/bin
# Only what is imported is compiled: that saves 50 MB.
PIP_INSTALL := $(BIN)/python -m pip install --no-compile \
	--only-binary :all: --editable

# Matrices here are small: threads inside BLAS cost more than they save.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# What Python compiles is kept: tests start many of it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: push test learn lint browser coverage site results robustness policy \
	league rows clean

push: .venv/installed
	$(BIN)/python scripts/push.py $(ARGS)

test: lint browser
	$(BIN)/pytest -n 2 --dist worksteal $(ARGS)

# The notebooks, in a browser.
learn: .venv/installed
	$(PIP_INSTALL) '.[notebook]'
	$(BIN)/jupyter lab --ServerApp.root_dir=$(CURDIR) \
		docs/learn/point_mass.ipynb $(ARGS)

# The lines that the tests have run.
coverage: browser
	COVERAGE_CORE=sysmon $(BIN)/pytest -n 2 --dist worksteal \
		--cov=nadia_balance --cov-report=term:skip-covered $(ARGS)

# The site: guide, reference, API.  Any warning is an error.
site: .venv/installed-test
	$(BIN)/python -m sphinx -q -W --keep-going -c docs/site . build/site/html
	@echo "wrote build/site/html/index.html"

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

# Remakes the results and pictures of docs from this commit, on two cores in less
# than 90 minutes.  Finished parts stay in MADE: after an interruption the same
# command goes on.
MADE := build/$(shell git rev-parse --short HEAD)

results: .venv/installed-test browser \
		$(MADE)/fig10.swept $(MADE)/g1_landing.swept \
		$(MADE)/push/replay.html $(MADE)/blocks/replay.html \
		$(MADE)/figures/nadia_figure_4.png
	$(PIP_INSTALL) '.[notebook]'
	$(BIN)/python docs/figures/picture.py --run $(MADE)/push --gif \
		--width 640 --height 600 --distance 3.6 --out docs/push.gif
	$(BIN)/python docs/figures/picture.py --run $(MADE)/blocks \
		--times 5.9 10.5 16.3 --azimuth 60 --elevation 18 --distance 4.6 \
		--width 270 --height 300 --out docs/ground.png
	cp $(MADE)/figures/nadia_figure_4.png docs/capture_regions.png
	cp $(MADE)/figures/nadia_figure_4.svg docs/capture_regions.svg
	$(BIN)/python docs/figures/envelopes.py --out docs/envelopes.png
	$(BIN)/python docs/figures/play.py --out docs/play.html
	for book in docs/learn/*.ipynb; do \
		$(BIN)/python -c 'import nbclient, nbformat, sys; \
			book = nbformat.read(sys.argv[1], 4); \
			nbclient.NotebookClient(book, record_timing=False).execute(); \
			nbformat.write(book, sys.argv[1])' $$book || exit 1; \
	done
	$(BIN)/python docs/figures/reference.py
	$(BIN)/python -c 'import sys; \
		from nadia_balance.results.versions import commit_of; \
		print("commit", commit_of(), "python", *sys.version_info[:2])' \
		> docs/results/made.txt
	sha256sum docs/*.gif docs/learn/*.ipynb docs/*.png docs/*.svg \
		docs/results/*/*.png docs/results/*/*.svg >> docs/results/made.txt

$(MADE)/g1_landing.swept: SWEEP := --robot g1 --resolution 0.05 --stride 4 \
	--mechanisms all_with_cross_over
$(MADE)/%.swept:
	$(BIN)/python scripts/envelope.py --replicas 3 $(SWEEP) --out $(MADE)/$*
	mkdir -p docs/results/$*
	cp $(MADE)/$*/* docs/results/$*
	sed -i 's,$(MADE),docs/results,' docs/results/$*/command.txt
	touch $@

# What the limits of `make results` are worth elsewhere: single pushes at a share
# of them, Atlas at its paper's, the G1 at other moments and in MuJoCo, sensors.
SINGLE := 95 80 60 moments errors mujoco random fig6 fig6_2017 fig6_demo
SWEPT := g1 g1_moments g1_mujoco sensors standing g1_standing

robustness: .venv/installed-test \
		$(SINGLE:%=$(MADE)/%.pushed) $(SWEPT:%=$(MADE)/%.swept)

$(MADE)/95.pushed: PUSHES := --share 0.95 --directions 24
$(MADE)/80.pushed: PUSHES := --share 0.8 --directions 24
$(MADE)/60.pushed: PUSHES := --share 0.6 --directions 24
$(MADE)/moments.pushed: PUSHES := --share 0.6 --directions 6 \
	--at "right transfer 50 %, right swing 10 %, right swing 30 %, \
	right swing 50 %, right swing 70 %, right swing 90 %"
$(MADE)/errors.pushed: PUSHES := --share 0.8 --directions 8 \
	--scenario_text "{imperfections: {joint_noise: 0.0005, \
	joint_speed_noise: 0.02, pelvis_noise: 0.001, pelvis_speed_noise: 0.02, \
	delay: 0.012, friction_ratio: 0.5, torso_mass_ratio: 1.1}}"
$(MADE)/random.pushed: PUSHES := --share 0.6 --pushes 300
$(MADE)/mujoco.pushed: PUSHES := --share 0.9 --directions 12 --engine mujoco
FIG6 := --limits atlas_fig6 --share
$(MADE)/fig6.pushed: PUSHES := $(FIG6) 1 --mechanisms all_with_cross_over \
	--scenario_text "{mechanisms: all_with_cross_over, controller: \
	{icp_step_qp: null, timing_adapter: {min_swing_duration: 0.25}}}"
$(MADE)/fig6_2017.pushed: PUSHES := $(FIG6) 1
$(MADE)/fig6_demo.pushed: PUSHES := $(FIG6) 0.7 \
	--scenario_name atlas_forward_fast,atlas_in_place_fast \
	--scenario_text "{controller: {timing_adapter: {min_swing_duration: 0.5}}, \
	pushes: [{body: mtorso, delta_v: 0.0, duration: 0.072, \
	at: right swing 50 %, after_steps: 2}]}"
$(MADE)/%.pushed:
	$(BIN)/python scripts/single_pushes.py $(PUSHES) --out $(MADE)/$*
	mkdir -p docs/results/single/$*
	cp $(MADE)/$*/* docs/results/single/$*
	sed -i 's,$(MADE),docs/results/single,' docs/results/single/$*/command.txt
	touch $@

# Beside a policy any landing counts, as its own steps come down too hard.
BESIDE := --robot g1 --stride 4 --scenario_text \
	"{landing: {speed_along: 10.0, speed_down: 10.0, mean_force: 100.0}}"
COARSE := --resolution 0.1 --replicas 1
G1_BESIDE := $(BESIDE) --mechanisms all_with_cross_over
LATER := right swing 50 %, right swing 75 %, left transfer 50 %
$(MADE)/g1.swept: SWEEP := $(G1_BESIDE) --resolution 0.05
$(MADE)/g1_moments.swept: SWEEP := $(G1_BESIDE) $(COARSE) --at "$(LATER)"
$(MADE)/g1_mujoco.swept: SWEEP := $(G1_BESIDE) $(COARSE) --engine mujoco \
	--at "right swing 25 %, $(LATER)"
$(MADE)/sensors.swept: SWEEP := --sensors consumer \
	--mechanisms all_with_cross_over
STANDING := --at standing --resolution 0.05 --stride 4 \
	--mechanisms all_with_cross_over
$(MADE)/standing.swept: SWEEP := $(STANDING)
$(MADE)/g1_standing.swept: SWEEP := --robot g1 $(STANDING)

# A learned policy in the place of our controller, by its file on PyPI.
POLICY := build/fastsac_g1_29dof.onnx
BESIDE_US := $(BESIDE) $(COARSE) --controller $(POLICY)
MOMENTS := --at "right swing 25 %, $(LATER)"
policy: .venv/installed-test $(POLICY) $(MADE)/g1_policy_moments.swept \
		$(MADE)/g1_policy_mujoco.swept $(MADE)/g1_policy_ideal.swept \
		$(MADE)/g1_policy_standing.swept

$(MADE)/g1_policy_moments.swept: SWEEP := $(BESIDE_US) $(MOMENTS)
$(MADE)/g1_policy_mujoco.swept: SWEEP := $(BESIDE_US) $(MOMENTS) --engine mujoco
$(MADE)/g1_policy_ideal.swept: SWEEP := $(BESIDE_US) --fidelity ideal
$(MADE)/g1_policy_standing.swept: SWEEP := $(BESIDE_US) --at standing
build/%_g1_29dof.onnx:
	$(BIN)/python -m pip install --no-deps --target build/holosoma \
		holosoma-inference==0.1.3
	cp build/holosoma/*/models/loco/g1_29dof/$(@F) $@

# The page of the league, from the rows in docs/league.
league: .venv/installed-test
	$(BIN)/python docs/figures/league.py

# These rows by push-v1: hours each, and some minutes with ROW=--quick.
ROW_NAMES := nadia g1 atlas springs_nadia springs_g1 fastsac_g1 ppo_g1
rows: .venv/installed-test $(ROW_NAMES:%=$(MADE)/%.row)
	$(MAKE) league

SPRINGS := --controller examples.null_controller:Springs
$(MADE)/nadia.row: MEASURED := --robot nadia
$(MADE)/g1.row: MEASURED := --robot g1
$(MADE)/atlas.row: MEASURED := --robot atlas
$(MADE)/springs_nadia.row: MEASURED := --robot nadia $(SPRINGS)
$(MADE)/springs_g1.row: MEASURED := --robot g1 $(SPRINGS)
$(MADE)/fastsac_g1.row: build/fastsac_g1_29dof.onnx
$(MADE)/fastsac_g1.row: MEASURED := --robot g1 \
	--controller build/fastsac_g1_29dof.onnx
$(MADE)/ppo_g1.row: build/ppo_g1_29dof.onnx
$(MADE)/ppo_g1.row: MEASURED := --robot g1 \
	--controller build/ppo_g1_29dof.onnx
$(MADE)/%.row:
	$(BIN)/python scripts/envelope.py --protocol push-v1 $(MEASURED) $(ROW) \
		--who nadia_balance --out $(MADE)/row_$*
	mkdir -p docs/league/$*
	cp $(MADE)/row_$*/row.json $(MADE)/row_$*/trials.csv docs/league/$*
	touch $@

$(MADE)/push/replay.html:
	$(BIN)/python scripts/push.py --out $(@D)

$(MADE)/blocks/replay.html:
	$(BIN)/python scripts/simulate.py --scenario_name cinder_blocks --out $(@D)

$(MADE)/figures/nadia_figure_4.png:
	$(BIN)/python docs/figures/atlas_paper.py --out $(@D)
	$(BIN)/python docs/figures/nadia_paper.py --out $(@D)

clean:
	rm -rf .venv build dist *.egg-info nadia_balance/core/math/*.so.1

# Drake's wheel brings its libraries along, all but GLib.  Our geometry is
# compiled.
.venv/installed: pyproject.toml setup.py nadia_balance/core/math/geometry.c
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "nadia_balance needs Python 3.11 or newer: make PYTHON=..."; \
		exit 1; }
	@command -v cc || command -v gcc || command -v clang \
		|| sh .ci/apt gcc libc6-dev || { \
		echo "nadia_balance needs a C compiler: apt-get install gcc libc6-dev"; \
		exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP_INSTALL) .
	$(BIN)/python -m pip uninstall --quiet --yes setuptools  # of Python 3.11
	$(BIN)/python -c 'import pydrake.common' || sh .ci/apt libglib2.0-0
	@find .venv -path '*/pip/*' -name '*.pyc' -delete  # 8 MB
	@touch $@

.venv/installed-test: .venv/installed
	$(PIP_INSTALL) '.[test]'
	@touch $@
