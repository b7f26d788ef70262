#!/bin/sh
# What the tests run of the Python packages, servers and commands included, and what the C++ tests
# run of the core. Prints a summary, and writes build/coverage/python and build/coverage/core.
# Further arguments are pytest's; without any, it runs what is not slow.
set -eu
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
CXX=$(sh scripts/compiler.sh)
export CXX
out=$PWD/build/coverage
rm -rf "$out"
mkdir -p "$out"

python -m pip install --quiet --disable-pip-version-check "coverage>=7.10" "gcovr>=8"

# Threads count in the same counters.
cmake -S zenoh_tf/core -B build/core-coverage -G Ninja --log-level=WARNING -DZTF_BUILD_TESTS=ON \
    -DCMAKE_BUILD_TYPE=Debug "-DCMAKE_CXX_FLAGS=--coverage -fprofile-update=atomic -O1"
cmake --build build/core-coverage -- --quiet
find build/core-coverage -name "*.gcda" -delete
core=0
ctest --test-dir build/core-coverage --output-on-failure --no-tests=error >"$out/core.log" 2>&1 ||
    core=$?
gcovr --root . --filter zenoh_tf/core/ --gcov-ignore-parse-errors=all --html-details "$out/core.html" \
    --txt "$out/core.txt" --json-summary "$out/core.json" --exclude-unreachable-branches \
    build/core-coverage >/dev/null 2>&1 || core=$?

# The configuration is in pyproject.toml: subprocesses count, and those that end by a signal.
[ $# -gt 0 ] || set -- -m "not slow"
python=0
COVERAGE_FILE=$out/.coverage python -m coverage run -m pytest -q "$@" >"$out/python.log" 2>&1 ||
    python=$?
export COVERAGE_FILE="$out/.coverage"
coverage combine --quiet "$out"
coverage html --quiet --directory "$out/python"
coverage json --quiet -o "$out/python.json"

python scripts/coverage_summary.py "$out"
[ "$core" = 0 ] || echo "the C++ tests failed: see $out/core.log"
[ "$python" = 0 ] || echo "pytest failed: see $out/python.log"
exit $((core || python))
