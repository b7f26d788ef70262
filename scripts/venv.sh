#!/bin/sh
# Creates .venv and installs requirements into it, but not the project itself.
#   venv.sh runtime   what the build and the programs need
#   venv.sh dev       what tests, benchmarks and checks need as well
# Prints what is missing on this machine, and how to install it.
set -eu
cd "$(dirname "$0")/.."
what=${1:-dev}

fail() {
    printf 'zenoh-tf: %s\n' "$@" >&2
    exit 1
}

find_python() {
    for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11 python3.10}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

python=$(find_python) || fail \
    "no Python 3.10 or later found (tried: ${PYTHON:-python3, python3.14 ... python3.10})." \
    "Install one (Debian, Ubuntu: apt-get install python3 python3-venv python3-dev), or name it: make PYTHON=/path/to/python3"

"$python" -c 'import venv, ensurepip' 2>/dev/null || fail \
    "$python cannot make virtual environments: its venv module is missing." \
    "Install it (Debian, Ubuntu: apt-get install python3-venv)."

"$python" - <<'PY' || fail \
    "$python has no C headers (Python.h), which the native module needs." \
    "Install them (Debian, Ubuntu: apt-get install python3-dev)."
import pathlib, sys, sysconfig
sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").is_file())
PY

sh scripts/compiler.sh >/dev/null

# Replaces a virtual environment that is incomplete, or was made by a Python that is gone.
if ! .venv/bin/python -c 'import pip' 2>/dev/null; then
    rm -rf .venv
    echo "making .venv with $("$python" --version): some seconds"
    "$python" -m venv .venv
fi

# The requirements are listed only in pyproject.toml, which Python 3.10 needs tomli to read.
.venv/bin/python -c 'import tomllib' 2>/dev/null ||
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "tomli>=2"
.venv/bin/python - "$what" >.venv/requirements.txt <<'PY'
import sys
try:
    import tomllib
except ModuleNotFoundError:
    import tomli as tomllib
with open("pyproject.toml", "rb") as file:
    config = tomllib.load(file)
project = config["project"]
requirements = config["build-system"]["requires"] + project["dependencies"]
if sys.argv[1] == "dev":
    extras = project["optional-dependencies"].items()
    requirements += sum((extra for name, extra in extras if name != "dist"), [])
for requirement in requirements:
    if not requirement.startswith(project["name"]):
        print(requirement)
PY
if [ "$what" = dev ]; then
    echo "installing what tests, benchmarks and checks need into .venv: about a minute"
else
    echo "installing what the build and the programs need into .venv: about a minute"
fi
.venv/bin/python -m pip install --quiet --disable-pip-version-check -r .venv/requirements.txt ||
    fail "pip could not install the requirements (see above). A package index must be reachable."
