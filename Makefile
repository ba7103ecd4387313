# `make run` and `make test` need nothing but Python 3.10 to 3.13 on x86_64 Linux; `make help` lists the rest.

PYTHONS := python3.11 python3.12 python3.13 python3.10 python3
SUITABLE := import platform, sys; \
	sys.exit(not ((3, 10) <= sys.version_info[:2] <= (3, 13) and sys.platform == "linux" and platform.machine() == "x86_64"))
PYTHON ?= $(shell for p in $(PYTHONS); do if $$p -c '$(SUITABLE)' 2>/dev/null; then command -v $$p; break; fi; done)

VENV := .venv
BIN := $(VENV)/bin
CHAPTERS := chapter4 chapter5 baseline mobile seek
# A run is this machine's own affair unless its user says otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Where the environment's ROS packages lie; the wheels do not say it themselves.
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)$(if $(AMENT_PREFIX_PATH),:$(AMENT_PREFIX_PATH))
# An outer environment's guard would keep this environment's interpreter from finding its ROS libraries.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONPATH

# What importing ROS's wheels would set by starting the interpreter once more.
IN_ROS = LD_LIBRARY_PATH="$(CURDIR)/$(VENV)/lib$$(printf ':%s' "$(CURDIR)/$(VENV)"/lib/python3.*/site-packages/ros_*.libs)$${LD_LIBRARY_PATH:+:$$LD_LIBRARY_PATH}" \
	_ROS_WHEELS_BOOTSTRAP_COMPLETE=1

ARGS ?=
# Test files that run at a time: one more than most machines of CI have cores, since system tests wait for the pace of runs.
JOBS ?= 3
PARAMS ?= params/seagate_7200_10.yaml

.PHONY: help run simulate figures test lint bench faults docs html ws clean

help:
	@echo 'make run       set up, run the whole graph, record it, sum it up; ARGS="-p rig:controller:=pid" changes it'
	@echo 'make simulate  the same experiment without middleware'
	@echo 'make figures   the experiments of chapters 4 and 5, of the baseline, of mobile use and of seeks by the graph, figures and tables; ARGS="--without-ros" is faster'
	@echo 'make test      set up and run all tests; ARGS="-k drive" picks some'
	@echo 'make lint      ruff, mypy, the layers of the package (.importlinter), spelling and prose'
	@echo 'make bench     the benchmarks, into docs/performance.md'
	@echo 'make faults    campaigns of kills, stray messages, odd parameters, damaged files, full disks and a long run, into docs/reliability.md; ARGS="kills --trials 20"'
	@echo 'make docs      the generated reference pages and the picture of the graph, from the declarations'
	@echo 'make html      the documentation as a site that works without a network: build/html/index.html'
	@echo 'make ws        colcon build, as ros2 run expects it in install/'
	@echo 'make clean     remove the environment and everything built'

run: $(VENV)/.run
	@$(IN_ROS) $(BIN)/rig --ros-args --params-file $(PARAMS) $(ARGS)

simulate: $(VENV)/.run
	@$(IN_ROS) $(BIN)/simulate --ros-args --params-file $(PARAMS) $(ARGS)

figures: $(VENV)/.run
	$(foreach chapter,$(CHAPTERS),$(BIN)/study $(chapter) $(ARGS) &&) true

test: $(VENV)/.develop
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder $(ARGS)

# mypy runs twice: the folders of the tests are not packages and some of their files share a name, so that it needs their
# paths; by paths it would take the folder launch/ for the package launch, so that the package is checked without.
lint: $(VENV)/.develop
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy hdd_servo_ros
	$(BIN)/mypy --namespace-packages --explicit-package-bases test benchmarks faults prose
	$(BIN)/lint-imports
	$(BIN)/codespell
	$(BIN)/python -m prose

bench: $(VENV)/.develop
	$(BIN)/python -m benchmarks $(ARGS)

faults: $(VENV)/.develop
	$(BIN)/python -m faults $(ARGS)

docs: $(VENV)/.run
	$(BIN)/python -m hdd_servo_ros.graph.manual docs

# The folder above docs/ is the source folder, as for rosdoc2: docs/conf.py explains it.
html: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -q -d build/doctrees -c docs . build/html
	@echo 'open build/html/index.html in a browser'

ws: $(VENV)/.develop
	AMENT_PREFIX_PATH= PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/colcon --log-base log build --packages-select hdd_servo_ros \
		--base-paths . --build-base build --install-base install
	@ls install/hdd_servo_ros/lib/hdd_servo_ros

clean:
	rm -rf $(VENV) build install log

$(VENV)/.run: setup.py constraints.txt hdd_servo_ros/graph/catalog.py
	@$(call make_venv)
	@echo 'installing ROS 2 Jazzy and what the bench needs into $(VENV): about a minute, once'
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ros]'
	@touch $@

$(VENV)/.develop: $(VENV)/.run
	@echo 'installing what the tests need into $(VENV), once'
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ros,test,lint,ws,campaign]'
	@touch $@

$(VENV)/.docs: $(VENV)/.run
	@echo 'installing what the documentation site needs into $(VENV), once'
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ros,docs]'
	@touch $@

define make_venv
	if [ -z '$(PYTHON)' ]; then \
		echo 'hdd_servo_ros needs Python 3.10 to 3.13 on x86_64 Linux, for which ROS 2 Jazzy has wheels; found: '"$$(uname -sm), $$(python3 --version 2>&1)" >&2; \
		exit 1; \
	fi; \
	$(PYTHON) -c '$(SUITABLE)' || { \
		echo 'hdd_servo_ros needs Python 3.10 to 3.13 on x86_64 Linux, for which ROS 2 Jazzy has wheels; $(PYTHON) is '"$$($(PYTHON) --version 2>/dev/null | head -n 1) on $$(uname -sm)" >&2; \
		exit 1; \
	}; \
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV) || { \
		echo 'could not make $(VENV) with $(PYTHON): its venv module is incomplete (on Debian and Ubuntu: apt install python3-venv)' >&2; \
		exit 1; \
	}
endef
