#!/bin/sh
# Builds and runs the stand-alone C++ tests, once for each argument: plain, thread, address.
set -eu
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
CXX=$(sh scripts/compiler.sh)
export CXX
# Without this a compiler cache keeps nothing that uses a precompiled header.
export CCACHE_SLOPPINESS=pch_defines,time_macros

for variant in "$@"; do
    sanitizer=$variant
    [ "$variant" = plain ] && sanitizer=
    echo "core tests: $variant"
    cmake -S zenoh_tf/core -B "build/core-$variant" -G Ninja --log-level=WARNING \
        -DZTF_BUILD_TESTS=ON -DZTF_WERROR=ON "-DZTF_SANITIZE=$sanitizer"
    cmake --build "build/core-$variant" -- --quiet
    ctest --test-dir "build/core-$variant" --output-on-failure --no-tests=error -j 2
done
