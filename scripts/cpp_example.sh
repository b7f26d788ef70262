#!/bin/sh
# Builds libzenoh_tf, installs it below build/library, and runs the examples against what is there,
# as a project of somebody else would. The first argument is another place to install it.
set -eu
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
CXX=$(sh scripts/compiler.sh)
export CXX
build=build/library
prefix=${1:-$PWD/$build/installed}

cmake -S zenoh_tf/core -B $build -G Ninja --log-level=WARNING -DZTF_BUILD_LIBRARY=ON \
    "-DCMAKE_INSTALL_PREFIX=$prefix" -DCMAKE_INSTALL_LIBDIR=lib
cmake --build $build --target zenoh_tf -- --quiet
cmake --install $build >/dev/null
cmake -S examples/cpp -B $build/examples -G Ninja --log-level=WARNING "-DCMAKE_PREFIX_PATH=$prefix"
cmake --build $build/examples -- --quiet
for example in control_loop cloud; do
    echo "$example:"
    $build/examples/$example
done
