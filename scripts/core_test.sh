#!/bin/sh
# Builds and runs the stand-alone C++ tests, once for each argument: plain, thread, address.
# After --build it only builds them, and the driver of tests/history.
set -eu
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
CXX=$(sh scripts/compiler.sh)
export CXX
# Without this a compiler cache keeps nothing that uses a precompiled header.
export CCACHE_SLOPPINESS=pch_defines,time_macros

run=yes
targets=all
if [ "$1" = --build ]; then
    run=
    targets="all history_driver"
    shift
fi
for variant in "$@"; do
    sanitizer=$variant
    [ "$variant" = plain ] && sanitizer=
    cmake -S zenoh_tf/core -B "build/core-$variant" -G Ninja --log-level=WARNING \
        -DZTF_BUILD_TESTS=ON -DZTF_BUILD_LIBRARY=ON -DZTF_WERROR=ON "-DZTF_SANITIZE=$sanitizer"
    # shellcheck disable=SC2086 # several words
    cmake --build "build/core-$variant" --target $targets -- --quiet
    [ "$run" ] || continue
    echo "core tests: $variant"
    ctest --test-dir "build/core-$variant" --output-on-failure --no-tests=error -j 2
done
