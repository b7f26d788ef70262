#!/bin/sh
# Prints the C++ compiler that CMake will use, or says plainly that there is none for C++20.
set -eu
for candidate in ${CXX:-c++ g++ clang++}; do
    if command -v "$candidate" >/dev/null 2>&1; then
        if printf '#include <concepts>\n#include <atomic>\nint main() { std::atomic<int> a; a.wait(1); }\n' |
            "$candidate" -std=c++20 -x c++ -fsyntax-only - 2>/dev/null; then
            echo "$candidate"
            exit 0
        fi
        found="$candidate"
    fi
done
if [ -n "${found:-}" ]; then
    echo "zenoh-tf: the C++ compiler $found cannot compile C++20: GCC 11 or Clang 14 or later is needed." >&2
else
    echo "zenoh-tf: no C++ compiler found (tried: ${CXX:-c++, g++, clang++})." >&2
    echo "zenoh-tf: Install one (Debian, Ubuntu: apt-get install g++), or name it: make CXX=/path/to/c++" >&2
fi
exit 1
