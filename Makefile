# `make run` and `make test` need only Python 3.10 to 3.13 on x86_64 Linux; `make help` lists all targets.

PYTHONS := python3.11 python3.12 python3.13 python3.10 python3
SUITABLE := import platform, sys; \
	sys.exit(not ((3, 10) <= sys.version_info[:2] <= (3, 13) and sys.platform == "linux" and platform.machine() == "x86_64"))
PYTHON ?= $(shell for p in $(PYTHONS); do if $$p -c '$(SUITABLE)' 2>/dev/null; then command -v $$p; break; fi; done)

VENV := .venv
BIN := $(VENV)/bin
CHAPTERS := chapter4 chapter5 baseline mobile seek
# Runs are visible on this machine only, unless the variable is set.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Path of the ROS packages in the environment; the wheels do not set it.
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)$(if $(AMENT_PREFIX_PATH),:$(AMENT_PREFIX_PATH))
# The guard variable of another environment would keep this interpreter from finding its ROS libraries.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONPATH

# Without these variables, importing the ROS wheels would restart the interpreter to set them.
IN_ROS = LD_LIBRARY_PATH="$(CURDIR)/$(VENV)/lib$$(printf ':%s' "$(CURDIR)/$(VENV)"/lib/python3.*/site-packages/ros_*.libs)$${LD_LIBRARY_PATH:+:$$LD_LIBRARY_PATH}" \
	_ROS_WHEELS_BOOTSTRAP_COMPLETE=1

ARGS ?=
# Test files that run at the same time: one more than the cores of most CI machines, because paced system tests wait.
JOBS ?= 3
PARAMS ?= params/seagate_7200_10.yaml

.PHONY: help run simulate figures test lint bench faults docs html ws clean

help:
	@echo 'make run       set up, run the whole graph, record it, print a summary; ARGS="-p rig:controller:=pid" sets parameters'
	@echo 'make simulate  run the same experiment without ROS'
	@echo 'make figures   run the studies of chapters 4 and 5, the baseline, mobile use and seeks, make their figures and tables; ARGS="--without-ros" is faster'
	@echo 'make test      set up, run all tests; ARGS="-k drive" selects some'
	@echo 'make lint      check with ruff, mypy, lint-imports (layers of the package), codespell, and the prose check'
	@echo 'make bench     run the benchmarks, write docs/performance.md'
	@echo 'make faults    run campaigns of kills, stray messages, odd parameters, damaged files, full disks and a long run, write docs/reliability.md; ARGS="kills --trials 20" runs one'
	@echo 'make docs      write the generated reference pages and the diagram of the graph'
	@echo 'make html      build the documentation, which works without a network: build/html/index.html'
	@echo 'make ws        run colcon build into install/'
	@echo 'make clean     delete the environment and everything that was built'

run: $(VENV)/.run
	@$(IN_ROS) $(BIN)/rig --ros-args --params-file $(PARAMS) $(ARGS)

simulate: $(VENV)/.run
	@$(IN_ROS) $(BIN)/simulate --ros-args --params-file $(PARAMS) $(ARGS)

figures: $(VENV)/.run
	$(foreach chapter,$(CHAPTERS),$(BIN)/study $(chapter) $(ARGS) &&) true

test: $(VENV)/.develop
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder $(ARGS)

# mypy runs twice. The test folders are not packages, and some of their files have the same name, so mypy needs their
# paths. With paths it would take the folder launch/ for the package launch, so the package is checked without them.
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

# The parent of docs/ is the source folder, as for rosdoc2 (see docs/conf.py).
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
	@echo 'installing ROS 2 Jazzy and the other dependencies into $(VENV): about a minute, once'
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ros]'
	@touch $@

$(VENV)/.develop: $(VENV)/.run
	@echo 'installing the test dependencies into $(VENV), once'
	@$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ros,test,lint,ws,campaign]'
	@touch $@

$(VENV)/.docs: $(VENV)/.run
	@echo 'installing the documentation dependencies into $(VENV), once'
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
		echo 'cannot create $(VENV) with $(PYTHON): its venv module is incomplete (on Debian and Ubuntu: apt install python3-venv)' >&2; \
		exit 1; \
	}
endef
