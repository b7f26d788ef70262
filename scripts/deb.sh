#!/bin/sh
# Makes a Debian package of libzenoh_tf with its headers in dist, or in the folder of the argument.
# Needs dpkg-dev.
set -eu
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
CXX=$(sh scripts/compiler.sh)
export CXX
build=build/library

# A folder with scripts/cpp_example.sh, as the objects are the same.
cmake -S zenoh_tf/core -B $build -G Ninja --log-level=WARNING -DZTF_BUILD_LIBRARY=ON \
    -DCMAKE_INSTALL_PREFIX=/usr "-DCMAKE_INSTALL_LIBDIR=lib/$(dpkg-architecture -qDEB_HOST_MULTIARCH)"
cmake --build $build --target zenoh_tf -- --quiet
cpack -G DEB --config $build/CPackConfig.cmake -B "${1:-dist}"
rm -rf "${1:-dist}/_CPack_Packages"
