# Every target works from a fresh checkout: it makes .venv, fills it and builds the native module
# first where that is needed. Needs Python 3.11+, make and a C++20 compiler; the rest comes from PyPI.

BIN := .venv/bin
export PYTHON
# make's own default for CXX says nothing about what is installed: scripts/compiler.sh looks.
ifneq ($(origin CXX),default)
export CXX
endif

# Two calls of make in one checkout must not build into the same folders at once.
LOCK := $(if $(shell command -v flock),flock .venv.lock)

CORE := $(shell find zenoh_tf/core zenoh_tf/bindings -type f)
CPP := $(shell find zenoh_tf tests bench -name "*.?pp")

.DEFAULT_GOAL := help
.PHONY: help native demo test histories anomalies lint format bench figures core-test image-test clean

help: ## say what there is
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1	\2/p' Makefile | expand -t 20

native: .venv/native.stamp ## make .venv, build the native module, install it all editable

.venv/requirements.stamp: pyproject.toml scripts/venv.sh scripts/compiler.sh
	@$(LOCK) sh scripts/venv.sh
	@touch $@

# No build isolation: the build requirements are in .venv already, and CMake's cache stays valid.
.venv/native.stamp: .venv/requirements.stamp pyproject.toml $(CORE)
	@echo "building the native module"
	@compiler=$$(sh scripts/compiler.sh) && CXX=$$compiler $(LOCK) $(BIN)/python -m pip install \
		--quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

demo: native ## a server, sensors and clients on this machine, in under 20 s
	@$(BIN)/python examples/demo.py

test: native ## the C++ tests of the core, then pytest
	@$(LOCK) sh scripts/core_test.sh plain
	@$(BIN)/python -m pytest $(ARGS)

histories: native ## 10,000 random histories against the oracle, and against tf2 where it is installed
	@HISTORIES=10000 $(BIN)/python -m pytest tests/model/test_histories.py \
		tests/model/test_against_tf2.py -s $(ARGS)

anomalies: native ## 1,000,000 concurrent transactions, and every fault that the checker must find
	@ANOMALIES=1000000 $(BIN)/python -m pytest tests/history -s $(ARGS)

lint: native ## ruff, mypy --strict, clang-format
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/clang-format --dry-run --Werror $(CPP)

format: .venv/requirements.stamp ## format Python and C++, sort imports
	@$(BIN)/ruff check --select I --fix .
	@$(BIN)/ruff format .
	@$(BIN)/clang-format -i $(CPP)

bench: native ## the benchmarks, beside tf2 where it is installed; RESULTS=FILE keeps the medians as JSON
	@$(BIN)/python -m bench $(if $(RESULTS),--results $(RESULTS)) $(ARGS)

# What `make bench ARGS=core RESULTS=$(FIGURES_FROM)` has written.
FIGURES_FROM ?= bench/results/core-2-cores-amd-epyc.json
figures: native ## draw docs/figures from bench/results, without measuring
	@$(BIN)/python -m bench.plots $(FIGURES_FROM) docs/figures

core-test: .venv/requirements.stamp ## the C++ tests: plain, thread sanitizer, address and UB sanitizers
	@$(LOCK) sh scripts/core_test.sh plain thread address

image-test: native ## build the container image for real, run it, use it from outside
	@$(BIN)/python docker/image_test.py

clean: ## remove everything that make made
	rm -rf .venv .venv.lock build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
