#!/bin/sh
# Creates .venv and fills it with everything but the project itself. Says plainly what is missing.
set -eu
cd "$(dirname "$0")/.."

fail() {
    printf 'zenoh-tf: %s\n' "$@" >&2
    exit 1
}

find_python() {
    for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

python=$(find_python) || fail \
    "no Python 3.11 or later found (tried: ${PYTHON:-python3, python3.14 ... python3.11})." \
    "Install one (Debian, Ubuntu: apt-get install python3 python3-venv python3-dev), or name it: make PYTHON=/path/to/python3"

"$python" -c 'import venv, ensurepip' 2>/dev/null || fail \
    "$python cannot make virtual environments: its venv module is missing." \
    "Install it (Debian, Ubuntu: apt-get install python3-venv)."

"$python" - <<'PY' || fail \
    "$python came without its C headers (Python.h), which the native module needs." \
    "Install them (Debian, Ubuntu: apt-get install python3-dev)."
import pathlib, sys, sysconfig
sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").is_file())
PY

sh scripts/compiler.sh >/dev/null

# A virtual environment left by another Python, or cut off half made, is made anew.
if ! .venv/bin/python -c 'import pip' 2>/dev/null; then
    rm -rf .venv
    echo "making .venv with $("$python" --version)"
    "$python" -m venv .venv
fi

# The requirements stand in pyproject.toml and nowhere else.
.venv/bin/python - >.venv/requirements.txt <<'PY'
import tomllib
with open("pyproject.toml", "rb") as file:
    config = tomllib.load(file)
project = config["project"]
extras = project["optional-dependencies"]
for requirement in config["build-system"]["requires"] + project["dependencies"] + sum(extras.values(), []):
    if not requirement.startswith(project["name"]):
        print(requirement)
PY
echo "installing the requirements of pyproject.toml into .venv"
.venv/bin/python -m pip install --quiet --disable-pip-version-check -r .venv/requirements.txt ||
    fail "pip could not install the requirements (see above). A package index must be reachable."
