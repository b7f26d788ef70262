#!/usr/bin/env bash
# Runs the C++ tests of the core with each compiler and on each emulated processor that is found.
# Names what is missing with its Debian package and goes on. Fails if any run fails.
# Compiles the core for other systems, whose programs cannot run here.
# Logs are kept in build/platforms.
set -u
cd "$(dirname "$0")/.." || exit
export PATH="$PWD/.venv/bin:$PATH"
unset CXX
compiler=$(sh scripts/compiler.sh) || exit 1
machine=$(uname -m)
table=""
failed=0

# Adds a line to the table: platform, result, seconds.
report() { table+=$(printf '%-34s %-44s %6s' "$@")$'\n'; }

# Configures, builds and tests. Arguments: log, folder, compiler, emulator (may be empty), options.
build_and_test() {
    local log=$1 folder=$2 cxx=$3 emulator=$4 timeout_s=300
    [ -z "$emulator" ] || timeout_s=1800
    nice cmake -S zenoh_tf/core -B "$folder" -G Ninja -DZTF_BUILD_TESTS=ON \
        -DZTF_BUILD_LIBRARY=ON -DZTF_WERROR=ON \
        -DCMAKE_CXX_COMPILER="$cxx" -DCMAKE_CROSSCOMPILING_EMULATOR="${emulator// /;}" \
        -DZTF_TEST_TIMEOUT_S="$timeout_s" "${@:5}" >"$log" 2>&1 &&
        nice cmake --build "$folder" >>"$log" 2>&1 &&
        nice ctest --test-dir "$folder" --output-on-failure --no-tests=error >>"$log" 2>&1
}

# Arguments: platform, Debian packages, folder, compiler, emulator (may be empty), CMake options.
platform() {
    local name=$1 packages=$2 folder=build/platforms/$3 cxx=$4 emulator=$5 tool start=$SECONDS
    for tool in "$cxx" ${emulator%% *}; do
        if ! command -v "$tool" >/dev/null; then
            echo "$name: $tool is missing (Debian, Ubuntu: apt-get install $packages)"
            report "$name" "skipped: no $tool" ""
            return
        fi
    done
    echo "$name: $("$cxx" --version | head -n 1)"
    mkdir -p build/platforms
    local log=build/platforms/${name//[^A-Za-z0-9]/-}.log result
    if build_and_test "$log" "$folder" "$cxx" "$emulator" "${@:6}"; then
        result="passed: $(grep -c ' Passed ' "$log") test programs"
    else
        result="FAILED: see $log"
        failed=1
        tail -n 40 "$log"
    fi
    report "$name" "$result" $((SECONDS - start))
}

# All versions of Clang here that are named by their number, the oldest first.
clangs=$(compgen -c | grep -xE 'clang\+\+-[0-9]+' | sort -Vu)
oldest=$(head -n 1 <<<"$clangs")
newest=$(tail -n 1 <<<"$clangs")

platform "default compiler" "g++" default "$compiler" ""
platform "gcc 11" "g++-11" gcc-11 g++-11 ""
platform "${oldest:-clang++} (oldest found)" "clang" "${oldest:-clang}" "${oldest:-clang++}" ""
[ "$oldest" = "$newest" ] || platform "$newest (newest found)" "clang" "$newest" "$newest" ""
if [ "$machine" = x86_64 ]; then
    # Built once for each kind of processor; a change of the emulator compiles nothing again.
    platform "x86-64 without AVX2 (nehalem)" "qemu-user" default "$compiler" "qemu-x86_64 -cpu Nehalem"
    for cpu in cortex-a72 max; do
        platform "aarch64 ($cpu)" "g++-aarch64-linux-gnu qemu-user" aarch64 aarch64-linux-gnu-g++ \
            "qemu-aarch64 -cpu $cpu -L /usr/aarch64-linux-gnu" \
            -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64
    done
else
    report "emulated processors" "skipped: only from x86-64, this is $machine" ""
fi

# One file of all sources. Zig brings the headers and libraries of each system.
for target in aarch64-macos x86_64-macos x86_64-windows-gnu x86_64-linux-musl aarch64-linux-musl; do
    if ! command -v python-zig >/dev/null; then
        echo "$target: python-zig is missing (pip install ziglang)"
        report "$target" "skipped: no python-zig" ""
        continue
    fi
    echo "$target: zig $(python-zig version)"
    start=$SECONDS log=build/platforms/$target.log
    mkdir -p build/platforms
    (cd zenoh_tf/core && printf '#include "%s"\n' *.cpp */*.cpp) >build/platforms/core.cpp
    if nice python-zig c++ -target "$target" -std=c++20 -O1 -Wall -Wextra -Werror -Wno-psabi \
        -Izenoh_tf/core -c build/platforms/core.cpp -o build/platforms/core.o >"$log" 2>&1; then
        report "$target" "compiled, not run" $((SECONDS - start))
    else
        report "$target" "FAILED: see $log" $((SECONDS - start))
        failed=1
        tail -n 40 "$log"
    fi
done

printf '\n%-34s %-44s %6s\n%s' platform result seconds "$table"
exit $failed
