# Everything a user or CI runs. `make demo` and `make test` set up .venv by themselves.
PYTHON ?= $(shell command -v python3.11 || command -v python3 || echo python3.11)
TORCH_INDEX ?=
PIP_INDEX = $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX))
BIN := .venv/bin
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_INDEX) -c constraints.txt
OUT ?= out
WORKERS ?= 2
# A file's tests together, in the order of names: by their number the longest ones would come last, one process alone.
SPREAD = -n $(WORKERS) --dist loadscope --no-loadscope-reorder
export OMP_NUM_THREADS ?= 1
# Compiling the tests and the checked library anew takes every process of pytest 20 seconds.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: change help setup demo demo-seeds reliability test lint check check-all bench messy blind-rigs blind-pairs online gymnasium survival versus-sbi measured cost goals versus-sysid effect-pages exact calibration tables table-online thesis thesis-page known-posteriors figures hidden-effect hopper egocentric engines devices skid-steer fetch fetch-friction fetch-robustness planner clean
help:            ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

setup: .venv/.installed  ## make .venv and install the library with its pinned dependencies
.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null || \
	  { echo "onlinebayes needs Python 3.11, 3.12 or 3.13: install it, or run make PYTHON=/path/to/python3.11"; exit 2; }
	@echo "setting up .venv: a minute or two, once"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	@$(PIP) torch==2.13.0
	@$(PIP) -e '.[dev]'
	@touch $@

demo: setup      ## the main job: measurement -> missing effect -> posterior -> policy (under 5 minutes)
	$(BIN)/python -m recipes.demo --out $(OUT)/demo
demo-seeds: setup  ## the demo on five seeds -> docs/results/demo-seeds.json
	$(BIN)/python -m recipes.studies.demo_seeds

test: setup lint ## lint, types, import rules, fast tests (6 to 7 minutes; WORKERS=2 processes)
	$(BIN)/python -m pytest $(SPREAD)
lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

check: setup     ## a sample of the slow evidence (half an hour)
	$(BIN)/python -m pytest -m slow --durations 60 --timeout 1200 $(SPREAD)
check-all: setup ## all of the slow evidence that is a test (longer)
	$(BIN)/python -m pytest -m "slow or long" --durations 20 --timeout 1200 $(SPREAD)
.PHONY: fuzz
fuzz: setup      ## refine on 200 drawn problems (half an hour); each that fails is printed as the data that it was drawn from
	ONLINEBAYES_FUZZ=200 $(BIN)/python -m pytest -m slow tests/cli/test_fuzz_refine.py

.PHONY: front-door
front-door: setup  ## are logs read as people write them, in time (10 min) -> docs/results/front-door.json
	$(BIN)/python -m recipes.studies.front_door
.PHONY: public-robots
public-robots: setup  ## two public arms from init to a policy on the machine (20 min) -> docs/results/public-robots.json
	$(BIN)/python -m recipes.studies.public_robots
bench: setup     ## speed -> docs/results/bench.json
	$(BIN)/python -m recipes.studies.speed
blind-rigs: setup  ## the same on eight rigs (an hour; goes on where it was stopped) -> docs/results/blind-rigs.json
	$(BIN)/python -m recipes.studies.blind_rigs --out $(OUT)/blind_rigs
reliability: setup  ## is a name called 95 % probable right in 95 % of cases (hours; goes on where it was stopped) -> docs/results/reliability.json
	$(BIN)/python -m recipes.studies.reliability --out $(OUT)/reliability
.PHONY: ablation
ablation: setup  ## the same blind cases with each rule of the search and without it (an hour; goes on where it was stopped) -> docs/results/ablation.json
	$(BIN)/python -m recipes.studies.ablation --out $(OUT)/ablation
.PHONY: ablation-numbers
ablation-numbers: setup  ## two rules taken out on machines of which only numbers are off (half an hour; goes on where it was stopped) -> docs/results/ablation-numbers.json
	$(BIN)/python -m recipes.studies.ablation --name ablation-numbers --rules "moments are believed where noise is left" "bounds are widened together" --effects 0 --own 1 --surplus 1 --rigs thrown_ball swing position_servo slide_drive cart_pole two_link_arm six_joint_arm --out $(OUT)/ablation_numbers
blind-pairs: setup  ## two effects at once on seeds of their own (an hour or two) -> docs/results/blind-pairs.json
	$(BIN)/python -m recipes.studies.blind_rigs --pairs 5 --first 9100 --out $(OUT)/blind_pairs
messy: setup     ## refine on machines with one or two large faults and six to ten small ones (goes on where it was stopped) -> docs/results/messy.json
	$(BIN)/python -m recipes.studies.messy --out $(OUT)/messy
measured: setup  ## refine measured machines (needs ONLINEBAYES_DATA) -> docs/results/measured.json
	$(BIN)/python -m recipes.studies.measured
.PHONY: servo so101
servo: setup     ## hobby servos by volts and by their own control law (needs ONLINEBAYES_DATA) -> docs/results/measured.json
	$(BIN)/python -m recipes.studies.measured --sets xl330 xl330_servo sts3250
so101: setup     ## a hobby arm of six servos beside mujoco.sysid (needs ONLINEBAYES_DATA) -> docs/results/measured.json
	$(BIN)/python -m recipes.studies.measured --sets so101
.PHONY: skid-steer-logs
skid-steer-logs: setup  ## where two real robots are after 2 s of commands (needs ONLINEBAYES_DATA) -> docs/results/skid-steer-logs.json
	$(BIN)/python -m recipes.studies.skid_steer_logs
cost: setup      ## seconds and memory of refine, and how they grow -> docs/results/cost.json
	$(BIN)/python -m recipes.studies.cost
goals: setup     ## which goals the studies hold and miss, read off their tables -> docs/results/goals.md
	$(BIN)/python -m recipes.studies.goals
.PHONY: pages
pages: setup     ## the pages of docs/results from the tables that there are (seconds)
	$(BIN)/python -m recipes.studies.pages
versus-sysid: setup  ## refine and its fit against mujoco.sysid (hours; goes on where it was stopped) -> docs/results/versus-sysid.json
	@$(PIP) -e '.[peers]'
	$(BIN)/python -m recipes.studies.versus_sysid --out $(OUT)/versus_sysid
online: setup    ## online learning beside a posterior first, the prior and an oracle (hours; goes on where it was stopped) -> docs/results/online.json
	$(BIN)/python -m recipes.studies.online --out $(OUT)/online

exact: setup     ## the neural posterior beside the exact one (an hour; goes on where it was stopped) -> docs/results/exact.json
	$(BIN)/python -m recipes.studies.exact --out $(OUT)/exact
calibration: setup  ## does every amortised estimator's posterior mean what it says, and does the alarm ring (an hour or two; goes on where it was stopped) -> docs/results/calibration.json
	$(BIN)/python -m recipes.studies.calibration --out $(OUT)/calibration
tables: setup    ## Table 4.1 of the thesis, classic systems (an hour; goes on where it was stopped) -> docs/results/tables.json
	$(BIN)/python -m recipes.studies.tables --out $(OUT)/tables
table-online: setup  ## Table 5.1 of the thesis, classic systems, without noise and with (an hour or two; goes on where it was stopped) -> docs/results/table-online.json
	$(BIN)/python -m recipes.studies.table_online --out $(OUT)/table-online
thesis: setup    ## Tables 4.1 and 5.1 of the thesis, all columns, with and without noise (three hours; goes on where it was stopped) -> docs/results/thesis-4.1.json, thesis-5.1.json
	$(BIN)/python -m recipes.studies.thesis --out $(OUT)/thesis
thesis-page: setup  ## the tables of docs/thesis.md from the result files that there are
	$(BIN)/python -m recipes.studies.thesis --only-page
known-posteriors: setup  ## our posteriors and sbi's beside exact ones (an hour; goes on where it was stopped) -> docs/results/known-posteriors.json
	@$(PIP) -e '.[peers]'
	$(BIN)/python -m recipes.studies.known_posteriors --out $(OUT)/known-posteriors
figures: setup   ## figures 4.3, 4.4, 4.5 and 5.2 of the thesis (half an hour) -> docs/results/figure-*.png
	$(BIN)/python -m recipes.studies.figures
hidden-effect: setup  ## a model that grows while a policy learns (hours; goes on where it was stopped) -> docs/results/hidden-effect.json
	$(BIN)/python -m recipes.studies.hidden_effect --out $(OUT)/hidden_effect
fetch: setup     ## DDPG with hindsight on the Fetch arm: Reach, Push, Slide (hours; goes on where it was stopped) -> docs/results/fetch.json
	$(BIN)/python -m recipes.studies.fetch --out $(OUT)/fetch
.PHONY: fetch-told
fetch-told: setup ## a policy of the Fetch arm that is told the block's friction, beside one that is not (half an hour; goes on where it was stopped) -> docs/results/fetch-told.json
	$(BIN)/python -m recipes.studies.fetch --out $(OUT)/fetch --cases "push, prior" "push, told"
fetch-friction: setup  ## what trajectories of those policies tell of the friction (an hour after make fetch) -> docs/results/fetch-friction.json
	$(BIN)/python -m recipes.studies.fetch_friction --policies $(OUT)/fetch --out $(OUT)/fetch_friction
fetch-robustness: setup  ## figures 4.6 and 5.3 of the thesis: policies of the prior and of the posterior along the friction (an hour; goes on where it was stopped) -> docs/results/fetch-robustness.json
	$(BIN)/python -m recipes.studies.fetch_robustness --out $(OUT)/fetch_robustness
planner: setup   ## a planner over the belief: swing-ups, noises, risk, speed (ten minutes; goes on where it was stopped) -> docs/results/planner.json
	$(BIN)/python -m recipes.studies.planner --out $(OUT)/planner
skid-steer: setup  ## Table 5.2 and Figures 5.4 to 5.6 of the thesis: a planner over the belief, a belief in the loop, a load taken up midway (ten minutes; goes on where it was stopped) -> docs/results/skid-steer.json
	$(BIN)/python -m recipes.studies.skid_steer --out $(OUT)/skid_steer_study
hopper: setup    ## a hopper learnt in MuJoCo and judged in Drake, and its friction (a day; goes on where it was stopped) -> docs/results/hopper.json
	$(BIN)/python -m recipes.studies.hopper --out $(OUT)/hopper
egocentric: setup  ## chapter 3 of the thesis: which sensor to use on an energy budget (ten minutes; goes on where it was stopped; needs ONLINEBAYES_DATA) -> docs/results/egocentric.json
	$(BIN)/python -m recipes.studies.egocentric --out $(OUT)/egocentric
.PHONY: hopper-policies
hopper-policies: setup ## the policies alone, prior U[.3, .5], three seeds (an hour; goes on where it was stopped) -> docs/results/hopper-policies.json
	$(BIN)/python -m recipes.studies.hopper --parts policies --lows .3 --out $(OUT)/hopper
engines: setup   ## what parts a hopper in Drake from its model in MuJoCo, named by refine (half an hour; goes on where it was stopped) -> docs/results/engines.json
	$(BIN)/python -m recipes.studies.engines --out $(OUT)/engines
gymnasium: setup ## policies trained by our code on Gymnasium's own environments (an hour; goes on where it was stopped) -> docs/results/gymnasium.json
	$(BIN)/python -m recipes.studies.gymnasium --out $(OUT)/gymnasium
devices: setup   ## worlds and fits on the CPU and on a GPU (needs one) -> docs/results/devices.json
	$(BIN)/python -m recipes.studies.devices
change: setup    ## does the belief follow a machine that changes, and leave one alone that does not (goes on where it was stopped) -> docs/results/change.json
	$(BIN)/python -m recipes.studies.change --out $(OUT)/change
versus-sbi: setup  ## our estimator beside sbi's NPE on the same simulations (four hours; goes on where it was stopped) -> docs/results/versus-sbi.json
	@$(PIP) -e '.[peers]'
	$(BIN)/python -m recipes.studies.versus_sbi --out $(OUT)/versus_sbi
.PHONY: endurance
endurance: setup ## half an hour of online learning: does memory stay flat -> docs/results/endurance.json
	$(BIN)/python -m recipes.studies.endurance
.PHONY: wall-clock
wall-clock: setup  ## CartPole from nothing to solved with a posterior, beside stable-baselines3 and sbi (five minutes) -> docs/results/wall-clock.json
	@$(PIP) -e '.[peers]'
	$(BIN)/python -m recipes.studies.wall_clock --out $(OUT)/wall_clock
survival: setup  ## a run killed at twenty random moments ends as if it had not been -> docs/results/survival.json
	$(BIN)/python -m recipes.studies.survival --out $(OUT)/survival

.PHONY: pixels
pixels: setup    ## a pendulum's parameters from frames under changing light, beside those from its states (ten minutes) -> docs/results/pixels.json
	$(BIN)/python -m recipes.studies.pixels --out $(OUT)/pixels
effect-pages: setup  ## pictures and figures of the pages in docs/effects (five minutes)
	$(BIN)/python -m recipes.studies.effect_pages

.PHONY: site
site: setup      ## the documentation as a site, warnings are errors (a minute or two, once) -> out/site
	@$(PIP) -e '.[docs]'
	$(BIN)/python docs/site/shown.py $(OUT)/examples
	PYTHONPATH=. $(BIN)/python -m sphinx -W --keep-going -q -c docs/site -d $(OUT)/doctrees -D html_extra_path=$(abspath $(OUT)/examples) . $(OUT)/site
	@echo "open $(OUT)/site/index.html"

clean:           ## remove .venv and the outputs
	rm -rf .venv $(OUT)
