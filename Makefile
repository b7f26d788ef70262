# Every target works from a fresh checkout: it makes .venv, fills it and builds the native module
# first where that is needed. Needs Python 3.10+, make and a C++20 compiler; the rest comes from PyPI.

BIN := .venv/bin
export PYTHON
# Make's own default for CXX may not be installed, so scripts/compiler.sh searches for a compiler.
ifneq ($(origin CXX),default)
export CXX
endif

# Two calls of make in one checkout must not build into the same folders at once.
LOCK := $(if $(shell command -v flock),flock .venv.lock)

CORE := $(shell find zenoh_tf/core zenoh_tf/bindings -type f) $(wildcard zenoh_tf/*.pyi zenoh_tf/_core_stubs/*.pyi)
CPP := $(shell find include zenoh_tf tests bench examples -name "*.[ch]pp" -o -name "*.[ch]")

.DEFAULT_GOAL := help
.PHONY: help native demo demo-ros2 cpp-example deb setup check test test-ci test-slow test-packages test-all histories anomalies chaos fuzz soak attack \
	coverage mutants mutants-client lint format docs bench figures core-test platforms \
	wheel image-test clean

help: ## list the targets
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/make \1	\2/p' Makefile | expand -t 20

native: .venv/native.stamp .venv/requirements.stamp ## make .venv, build the native module, install it all editable

# What the build and the programs need, and after it what only tests and benchmarks need.
.venv/runtime.stamp: pyproject.toml scripts/venv.sh scripts/compiler.sh
	@$(LOCK) sh scripts/venv.sh runtime
	@touch $@

.venv/requirements.stamp: .venv/runtime.stamp
	@$(LOCK) sh scripts/venv.sh dev
	@touch $@

# No build isolation: the build requirements are in .venv already, and CMake's cache stays valid.
.venv/native.stamp: .venv/runtime.stamp pyproject.toml $(CORE)
	@echo "building the native module: about 2 minutes on 2 cores"
	@compiler=$$(sh scripts/compiler.sh) && CXX=$$compiler $(LOCK) $(BIN)/python -m pip install \
		--quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

demo: .venv/native.stamp ## a server, sensors and clients, in under 20 s (after minutes of set-up)
	@$(BIN)/python examples/demo.py

demo-ros2: .venv/native.stamp ## two emulated ROS 2 robots join a server, in under 20 s
	@$(BIN)/python examples/demo_ros2.py

cpp-example: .venv/runtime.stamp ## libzenoh_tf, and a program in C and one in C++ that use it
	@$(LOCK) sh scripts/cpp_example.sh

deb: .venv/runtime.stamp ## libzenoh_tf as a Debian package, in dist
	@$(LOCK) sh scripts/deb.sh

# More than cores, as tests also wait.
WORKERS ?= 3
# Where a system asks Python to keep no bytecode, each process of a test would compile the project.
CACHED := PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX=$(CURDIR)/build/pycache
PYTEST := $(CACHED) $(BIN)/python -m pytest
# Status 5 is that of no test at all.
define run_tests
	@$(PYTEST) -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(if $(1),-m "$(1)") $(ARGS) || [ $$? = 5 ]
endef

setup: native ## what `make test` needs, built once: native, and the C++ tests
	@$(LOCK) sh scripts/core_test.sh --build plain

# Folders whose tests without a server start no process either and compute for seconds at most.
UNITS := $(addprefix tests/,tree transforms conformance requests streams/test_wire_stream.py)
check: native ## the inner loop, in less than a minute after set-up: ruff, mypy, tests without servers
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@$(BIN)/mypy
	@$(PYTEST) -q -n $(WORKERS) -m "not slow and not service" $(UNITS) $(ARGS)

test: setup ## what every change must pass, under 10 minutes after set-up; ARGS="-k wire -x", ARGS="--durations=10 --count-servers"
	@$(LOCK) sh scripts/core_test.sh plain
	$(call run_tests,not slow)

# With `make lint docs test` it fits into 45 minutes.
test-ci: export ANOMALIES ?= 48000
test-ci: export CHAOS ?= 2000
test-ci: export FUZZ ?= 5000
test-ci: test-slow ## `make test-slow` with less of what is statistical, for continuous integration

test-slow: setup test-packages ## what is long or statistical: all histories, chaos, fuzz, exits, replicas, browser, other packages
	$(call run_tests,slow)

test-slow test-all: export ANOMALIES ?= 96000
test-slow test-all: export CHAOS ?= 10000
test-slow test-all: export FUZZ ?= 20000
test-all: core-test setup test-packages ## all tests, and those of the core under the sanitizers
	$(call run_tests)

# Outside of .venv, which has a newer one.
OLD_ZENOH := build/packages/eclipse-zenoh-1.5.1
test-packages: $(OLD_ZENOH) ## other projects' packages, which some tests need and otherwise skip
$(OLD_ZENOH): | .venv/requirements.stamp
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --target $@ \
		eclipse-zenoh==1.5.1

histories: native ## 10,000 random histories against the oracle, and against tf2 where it is installed
	@HISTORIES=10000 $(BIN)/python -m pytest tests/model/test_histories.py \
		tests/model/test_against_tf2.py -s $(ARGS)

anomalies: native ## 1,000,000 concurrent transactions, and every fault that the checker must find; ANOMALIES=96000 is short
	@ANOMALIES=$(or $(ANOMALIES),1000000) $(BIN)/python -m pytest tests/history -s $(ARGS)

chaos: native ## 200,000 remote transactions under kills, stops, partitions and frozen clients; CHAOS=20000 is short, SEED=N repeats a plan
	@CHAOS=$(or $(CHAOS),200000) $(BIN)/python -m pytest tests/chaos -s $(ARGS)

fuzz: native ## 1,000,000 damaged messages through Zenoh, then coverage-guided fuzzing; FUZZ=20000 and FUZZ_S=30 are short
	@FUZZ=$(or $(FUZZ),1000000) $(BIN)/python -m pytest tests/fuzz -s $(ARGS)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "atheris>=3.0"
	@for target in decoder handler key config; do \
		$(BIN)/python -m tests.fuzz.coverage $$target -max_total_time=$(or $(FUZZ_S),600) || exit 1; \
	done

soak: native ## an hour of mixed load, which must reach a plateau, and docs/figures/soak.svg; SOAK=120 is short
	@$(BIN)/python -m tests.soak --seconds $(or $(SOAK),3600) $(ARGS)

coverage: native ## what the tests run of Python, servers included, and of the core; ARGS="-m slow tests/chaos"
	@$(LOCK) sh scripts/coverage.sh $(ARGS)

mutants: native ## changes decisions of the core one by one; each must fail a C++ test; ARGS="walk replay" for some files
	@$(LOCK) $(BIN)/python -m tests.mutation $(ARGS)

MUTATED := build/mutants-client
# Prints how many percent survive; build/mutants-client/survivors.txt has each survivor.
mutants-client: native ## the same of the client's exchange, by cosmic-ray and tests/client/test_exchange.py
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "cosmic-ray>=8.4"
	@rm -rf $(MUTATED) && mkdir -p $(MUTATED)
	@cp client/zenoh_tf_client/session/exchange.py $(MUTATED)
	@$(BIN)/cosmic-ray init tests/mutation/exchange.toml $(MUTATED)/session.sqlite
	@$(BIN)/cr-filter-operators $(MUTATED)/session.sqlite tests/mutation/exchange.toml
	@$(CACHED) $(BIN)/cosmic-ray baseline tests/mutation/exchange.toml
	@$(CACHED) $(BIN)/cosmic-ray exec tests/mutation/exchange.toml $(MUTATED)/session.sqlite
	@$(BIN)/cr-report --show-diff --surviving-only $(MUTATED)/session.sqlite > $(MUTATED)/survivors.txt
	@$(BIN)/cr-rate $(MUTATED)/session.sqlite

attack: native ## attacks on real servers that may hold others up, and their bounds; ARGS="--case 13 28", ARGS="--python OTHER/.venv/bin/python"
	@$(BIN)/python -m tests.attack $(ARGS)

WORKFLOWS := $(wildcard .github/workflows/*.yml)
lint: native ## ruff, mypy --strict, clang-format, import-linter, scripts/checks; actionlint where it is installed
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/clang-format --dry-run --Werror $(CPP)
	@$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-workflows $(WORKFLOWS)
	@$(BIN)/check-jsonschema --quiet --builtin-schema vendor.compose-spec $(wildcard docker/compose*.yaml)
	@mkdir -p build && $(BIN)/lint-imports --no-cache > build/imports.txt || { cat build/imports.txt; exit 1; }
	@$(BIN)/python -m scripts.checks
	@if command -v actionlint >/dev/null; then actionlint $(WORKFLOWS); fi

format: .venv/requirements.stamp ## format Python and C++, sort imports, make the synchronous client
	@$(BIN)/python -m scripts.sync_client
	@$(BIN)/ruff check --select I --fix .
	@$(BIN)/ruff format .
	@$(BIN)/clang-format -i $(CPP)

# Strict: a warning, such as a dead link, is an error. Needs no network and no native module.
docs: .venv/requirements.stamp ## the documentation and the API reference, in build/site
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "documentation: build/site/index.html"

bench: native ## the benchmarks, beside tf2 where it is installed, in half an hour; RESULTS=bench/results keeps the medians
	@$(BIN)/python -m bench $(if $(RESULTS),--results $(RESULTS)) $(ARGS)

figures: native ## the documentation's measured numbers and figures from bench/results, without measuring
	@$(BIN)/python -m bench.figures $(ARGS)

core-test: .venv/requirements.stamp ## the C++ tests: plain, thread sanitizer, address and UB sanitizers
	@$(LOCK) sh scripts/core_test.sh plain thread address

platforms: .venv/requirements.stamp ## the C++ tests with Clang and GCC 11, on ARM64 and without AVX2 under qemu; compiled for other systems
	@$(LOCK) bash scripts/platforms.sh

wheel: ## an sdist and manylinux wheels in dist, each installed and smoke-tested
	@bash scripts/wheel.sh

image-test: native ## build the container image for real, run it, use it from outside
	@$(BIN)/python docker/image_test.py

clean: ## remove everything that make made
	rm -rf .venv .venv.lock build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
