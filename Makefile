# SPDX-License-Identifier: Apache-2.0
# `make` alone says what there is. The steps are in ros2_ws/bootstrap.py and in what the recipes call.

.DEFAULT_GOAL := help
IN_WORKSPACE := . ros2_ws/activate &&

.PHONY: help
help: ## this list
	@echo "ATPID: an adaptive tuned particle impact damper on ROS 2 Jazzy. What there is:"
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24
	@echo "A shell in which everything works:  . ros2_ws/activate"

# $(call set_up,lock): set up what is missing, and install one more lock of ros2_ws/requirements where it is named.
define set_up
	@for python in $(PYTHON) python3 python3.12 python3.11 python3.13 python3.10; do \
	    if $$python -c 'import sys; sys.exit(sys.version_info < (3, 8))' 2>/dev/null; then \
	        exec $$python ros2_ws/bootstrap.py $(1); \
	    fi; \
	done; \
	echo "set-up needs Python 3.10 to 3.13 with venv: sudo apt install python3 python3-venv python3-dev" >&2; exit 2
endef

.PHONY: setup
setup: ## set up what is missing (PYTHON=python3.12 names the interpreter)
	$(call set_up)

.PHONY: test-packages
test-packages: ## the same, and what the tests need beside: type checker, second middleware, cluster
	$(call set_up,tests)

.PHONY: bench
bench: setup ## the adaptive bench of thesis section 4.3: table, bag and report in out/bench
	@$(IN_WORKSPACE) atpid bench scenes/thesis_4_3.yaml --out out/bench

.PHONY: stand-emulated
stand-emulated: setup ## the whole stand without hardware: LabJack's package, real firmware, simulated physics
	@$(IN_WORKSPACE) atpid bench scenes/thesis_4_3.yaml --out out/stand --emulated-stand

# One thread of linear algebra each: with one for each core they wait for each other, ten times as long on a busy machine.
PYTEST = env OPENBLAS_NUM_THREADS=1 python -m pytest -q
# A file stays on one worker, since its tests share fixtures; one worker more than there are cores, since tests of
# processes wait for half of their time. A worker that crashes ends the run: xdist would wait for ever for its file.
ABREAST = -n $$(($$(nproc) + 1)) --maxprocesses 8 --max-worker-restart 0 --dist loadfile --no-loadscope-reorder
TESTS = atpid_interfaces/atpid_common/test atpid_sim/test atpid_driver/test atpid_control/test \
	$(wildcard extensions/*/test) tests
# $(call test,marks): the tests with these marks on every core, then those of them that are about the time on the clock.
test = $(IN_WORKSPACE) $(PYTEST) $(ABREAST) -m "$(1) and not wall_time" && \
	exec $(PYTEST) -m "$(1) and wall_time" $$(grep -rl --include='test_*.py' mark.wall_time $(TESTS))

.PHONY: test
test: test-packages ## format, types, import rules, and the tests that take a few minutes together
	@$(call test,not rest)

.PHONY: test-rest
test-rest: test-packages ## the tests that `make test` leaves out, by what each costs (tests/parts.py)
	@$(call test,rest)

.PHONY: test-all
test-all: test test-rest ## all tests

.PHONY: costs
costs: test-packages ## measure what each test costs, on a machine that does nothing else; what decides where it runs
	@$(IN_WORKSPACE) exec python tests/costs.py

.PHONY: fuzz
fuzz: test-packages ## every test at full length: 10^4 hostile files to each parser, 10^5 messages to each node, all draws (hours)
	@$(IN_WORKSPACE) exec $(PYTEST) $(ABREAST) --hypothesis-profile=long --timeout 14400 --dist load \
	    $$(grep -rl --include='test_*.py' 'get_current_profile_name() == "long"' tests atpid_*)

.PHONY: mutations
mutations: test-packages ## make each listed change of the safety path in a copy and run the tests that must fail (ONLY=, JOBS=)
	@$(IN_WORKSPACE) exec python tests/mutations/run.py --only "$(or $(ONLY),*)" --jobs $(or $(JOBS),2)

.PHONY: fresh
fresh: test-packages ## property tests with fresh examples for SECONDS (600); what fails is kept in tests/examples
	@$(IN_WORKSPACE) exec python tests/fresh.py $(or $(SECONDS),600)

.PHONY: benchmark
benchmark: test-packages ## how fast the parts are that run with the stand, in SECONDS (20) of its time
	@$(IN_WORKSPACE) exec env PYTHONPATH=.:$$PYTHONPATH python tests/benchmark.py $(or $(SECONDS),20)

.PHONY: test-install
test-install: test-packages ## build a clone as a ROS user does, remove it and run what was installed; all of colcon test
	@$(IN_WORKSPACE) exec env ATPID_COLCON_TESTS=all python -m pytest -q tests/test_installation.py

.PHONY: coverage
coverage: test-packages ## run the tests with coverage.py: table on the screen, pages in out/coverage
# Left out: what runs an installed copy, and a process that may write no file, coverage.py's own included.
	@$(IN_WORKSPACE) python -m coverage erase && \
	{ $(patsubst python,python -m coverage run,$(PYTEST)) $(ABREAST) --ignore tests/test_installation.py \
	      --deselect tests/test_outputs.py::test_a_disk_that_fills_up_costs_no_point_of_a_map; status=$$?; \
	  python -m coverage combine -q && python -m coverage html -q -d out/coverage && python -m coverage report --skip-covered; exit $$status; }

.PHONY: figures
figures: setup ## make every picture of README and docs again (a few minutes)
	@. ros2_ws/activate || exit 2; set -e; \
	atpid bench scenes/thesis_4_3.yaml --out out/figures; cp out/figures/overview.png docs/figures/bench.png; \
	atpid bag report bags/thesis_4_3_short --out out/mechanism; cp out/mechanism/grain.png docs/figures/grain.png; \
	python -m studies figures free_decay --out docs/figures; \
	python -m studies figures contact --out docs/figures; \
	python -m studies figures speed --out docs/figures; \
	python -m studies figures stand --out docs/figures; \
	python -m studies figures mechanism --out docs/figures; \
	python tests/tutorial.py; \
	python -m studies figures identification --out docs/figures; \
	python -m studies figures selection --out docs/figures; \
	python -m studies figures frequency --out docs/figures; \
	atpid design --mass 2 --frequency 15 --damping 0.02 --amplitudes 0.001:0.003 \
	    --max-mass-fraction 0.2 --target-efficiency 0.75 --out out/design; cp out/design/design.png docs/figures/design.png; \
	python -m studies thesis all --out out/study --page docs/research/thesis.md; \
	python -m studies methods scenes/thesis_4_3.yaml scenes/stepped_4_8_phi_0_3.yaml scenes/stiff_beam.yaml \
	    --out out/methods --page docs/research/methods.md; \
	python -m studies atlas --out out/atlas; cp out/atlas/atlas.png out/atlas/atlas_stability.png docs/figures; \
	for scene in standard sticking irregular; do \
	    python -m studies tradeoff scenes/$$scene.yaml --out out/tradeoff/$$scene; \
	done; \
	python -m studies tradeoff-page --out docs/research \
	    --regular out/tradeoff/standard --sticking out/tradeoff/sticking --irregular out/tradeoff/irregular

.PHONY: audit
audit: test-packages ## licences of what is installed, and known vulnerabilities of what is locked (asks PyPI)
	@$(IN_WORKSPACE) python ros2_ws/requirements/licences.py && python -m venv out/audit && \
	out/audit/bin/python -m pip install -q --no-deps --require-hashes -r ros2_ws/requirements/audit.txt && \
	out/audit/bin/pip-audit --disable-pip --require-hashes -r ros2_ws/requirements/wheels.txt -r ros2_ws/requirements/tests.txt

.PHONY: policy
policy: setup ## make the SROS 2 policy of the stand again, from its nodes (atpid_control/config/security/stand.policy.xml)
	@$(IN_WORKSPACE) atpid policy scenes/stand_realtime.yaml --out atpid_control/config/security/stand.policy.xml

.PHONY: firmware
firmware: ## build the motor's firmware (needs the AVR tools)
	@command -v avr-g++ > /dev/null || { echo "the firmware needs the AVR tools: sudo make avr-tools" >&2; exit 2; }
	@$(MAKE) --no-print-directory -C atpid_driver/firmware

# The wheel has what needs neither ROS nor a command line: the interface is `import atpid_sim`.
.PHONY: wheel
wheel: test-packages ## build the physics as a wheel in out/wheel and try it in empty environments (PYTHONS="python3.10 python3.13")
	@$(IN_WORKSPACE) rm -rf out/wheel && mkdir -p out/wheel/source && \
	cp -r ros2_ws/wheel/pyproject.toml LICENSE atpid_sim/atpid_sim atpid_interfaces/atpid_common/atpid_common \
	    extensions/atpid_dynamics/atpid_dynamics out/wheel/source && \
	python -m pip wheel -q --no-deps --no-build-isolation --wheel-dir out/wheel out/wheel/source && \
	exec env ATPID_PYTHONS="$(or $(PYTHONS),python3.10 python3.11 python3.12 python3.13)" \
	    python -m pytest -q -rA tests/test_wheel.py

.PHONY: lock
lock: ## resolve ros2_ws/requirements/*.in again (UPGRADE=--upgrade for the newest of everything)
	@ros2_ws/requirements/lock

.PHONY: avr-tools
avr-tools: ## install the AVR compiler and simulator (Debian, Ubuntu; needs root)
	apt-get update -q
	DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends \
	    gcc-avr avr-libc binutils-avr arduino-core-avr libsimavr-dev libelf-dev

.PHONY: cpp
cpp: setup ## build the messages for C++ too, which `ros2 bag`, built beside the wheels of ROS, needs (docs/installing.md)
	@$(IN_WORKSPACE) [ ! -d $$VIRTUAL_ENV/share/rclpy ] || { cd ros2_ws && \
	    exec env -u PYTHONPATH AMENT_PREFIX_PATH=$$VIRTUAL_ENV CMAKE_PREFIX_PATH=$$VIRTUAL_ENV python -m colcon build \
	    --symlink-install --base-paths src --packages-select atpid_interfaces --cmake-args -DATPID_PYTHON_ONLY=OFF \
	    -DPython3_EXECUTABLE=$$VIRTUAL_ENV/bin/python -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release; }

.PHONY: parquet
parquet: ## install what `atpid bag export --format parquet` needs, 170 MB (docs/recording.md)
	$(call set_up,parquet)

.PHONY: import
import: ## install what `atpid bag import` and `export` need for TDMS, and MATLAB 7.3 (docs/recording.md)
	$(call set_up,import)

.PHONY: docs
docs: docs-packages ## build the site of docs/ in out/docs/VERSION, the tag or `development`, beside those built before
	@$(IN_WORKSPACE) version=$$(git describe --tags --exact-match 2> /dev/null || echo development); \
	env ATPID_DOCS_VERSION=$$version PYTHONPATH=.venv/docs:$$PYTHONPATH \
	    python -m sphinx --fail-on-warning -q -c docs . out/docs/$$version && echo "the site: out/docs/index.html"

# In a folder of their own: Sphinx needs an older docutils than the other packages.
.PHONY: docs-packages
docs-packages: setup ## install what `make docs` builds the site with, 95 MB, into .venv/docs
	@cmp -s ros2_ws/requirements/docs.txt .venv/docs/docs.txt || { rm -rf .venv/docs && .venv/bin/python -m pip install -q \
	    --no-deps --require-hashes --target .venv/docs -r ros2_ws/requirements/docs.txt && cp ros2_ws/requirements/docs.txt .venv/docs; }

.PHONY: browser
browser: ## install Chromium and what drives it, for the tests of the live page (Debian; needs root)
	apt-get update -q
	DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends chromium
	$(call set_up,browser)

.PHONY: clean
clean: ## remove all that set-up and runs made
	rm -rf .venv ros2_ws/build ros2_ws/install ros2_ws/log ros2_ws/setup.log ros2_ws/.setup.lock out
	find . -name __pycache__ -prune -exec rm -rf {} +
