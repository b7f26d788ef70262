#!/bin/sh
# Prints the C++ compiler that CMake will use, or says what is missing. The oldest tested compilers
# are GCC 11 and Clang 14 (`make platforms`). Only 64-bit targets work: the core needs __int128.
set -eu

# Compiles what the core uses of the language, the library and the compiler's extensions.
can_compile_the_core() {
    "$1" -std=c++20 -x c++ -fsyntax-only - 2>/dev/null <<'CPP'
#include <algorithm>
#include <atomic>
#include <bit>
#include <span>
using Double4 = double __attribute__((vector_size(32)));
struct Row { int frame; unsigned __int128 hash; };
static_assert(std::atomic<unsigned long long>::is_always_lock_free && std::countr_zero(8u) == 3);
Double4 larger(Double4 a, Double4 b) { return a < b ? b : a; }
void sort(std::span<Row> rows) { std::ranges::sort(rows, {}, &Row::frame); }
void wait(std::atomic<int>& word) { word.wait(1); }
CPP
}

for candidate in ${CXX:-c++ g++ clang++}; do
    if command -v "$candidate" >/dev/null 2>&1; then
        if can_compile_the_core "$candidate"; then
            echo "$candidate"
            exit 0
        fi
        found="$candidate"
    fi
done
if [ -n "${found:-}" ]; then
    echo "zenoh-tf: the C++ compiler $found cannot compile the core." >&2
    echo "zenoh-tf: GCC 11 or Clang 14 or later with C++20 is needed, for a 64-bit target." >&2
else
    echo "zenoh-tf: no C++ compiler found (tried: ${CXX:-c++, g++, clang++})." >&2
    echo "zenoh-tf: Install one (Debian, Ubuntu: apt-get install g++), or name it: make CXX=/path/to/c++" >&2
fi
exit 1
