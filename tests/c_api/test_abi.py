"""The binary interface of the library is the one that `zenoh_tf.abi` keeps.

After an addition, `python -m tests.c_api.test_abi` renews that file. After a change that abidiff
calls incompatible, the SONAME must change too, which needs a new minor version.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DUMP = Path(__file__).with_name("zenoh_tf.abi")
FIELD = "  int64_t stamp_ns;\n  ztf_pose pose;\n} ztf_transform;"

pytestmark = [
    pytest.mark.skipif(platform.machine() != "x86_64", reason="the kept interface is x86-64's"),
    pytest.mark.skipif(
        not all(map(shutil.which, ("abidiff", "abidw", "g++"))),
        reason="needs abidiff and abidw (Debian: abigail-tools), and g++",
    ),
]


def run(command: str, *paths: Path) -> None:
    subprocess.run([*command.split(), *paths], check=True, timeout=300)


def dump(headers: Path, folder: Path) -> Path:
    """Write the types and symbols that the headers declare, without folders and lines.

    The interface is compiled alone, with its types; the core's symbols stay undefined.
    """
    sources, library, out = ROOT / "zenoh_tf", folder / "libzenoh_tf.so", folder / "zenoh_tf.abi"
    run(
        "g++ -std=c++20 -g -O0 -fPIC -shared -fvisibility=hidden -Wno-psabi"
        f' -DZTF_VERSION="0" -I{headers} -I{sources} -I{sources}/core'
        f" -Wl,--version-script={sources}/c_api/symbols.map -Wl,-soname,{library.name} -o",
        library,
        *sorted((sources / "c_api").glob("*.cpp")),
    )
    run(
        "abidw --drop-private-types --exported-interfaces-only --no-corpus-path --no-comp-dir-path"
        f" --no-show-locs --no-parameter-names --no-elf-needed --headers-dir {headers}/zenoh_tf"
        f" --out-file {out}",
        library,
    )
    return out


def difference(headers: Path, folder: Path) -> str:
    done = subprocess.run(
        ["abidiff", DUMP, dump(headers, folder)], check=False, capture_output=True, text=True
    )
    assert done.returncode & 3 == 0, done.stderr  # an error of abidiff, or of its use
    assert bool(done.returncode) == bool(done.stdout)
    return done.stdout


def changed(tmp_path: Path, before: str, after: str) -> Path:
    """Return a copy of the headers with one change."""
    headers = tmp_path / "include"
    shutil.copytree(ROOT / "include", headers)
    header = headers / "zenoh_tf/zenoh_tf.h"
    text = header.read_text()
    assert text.count(before) == 1
    header.write_text(text.replace(before, after))
    return headers


def test_the_interface_is_the_kept_one(tmp_path: Path) -> None:
    assert difference(ROOT / "include", tmp_path) == ""


def test_a_field_more_is_found(tmp_path: Path) -> None:
    longer = FIELD.replace("}", "  int64_t another;\n}")
    found = difference(changed(tmp_path, FIELD, longer), tmp_path)
    assert "int64_t another" in found
    assert "size changed from 640 to 704" in found


def test_another_type_of_an_argument_is_found(tmp_path: Path) -> None:
    before = "ZTF_API const char* ztf_code_name(int32_t code);"
    # An overload has no C name, so the function is also lost.
    headers = changed(tmp_path, before, before.replace("int32_t", "int64_t"))
    assert "ztf_code_name" in difference(headers, tmp_path)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(dump(ROOT / "include", Path(folder)), DUMP)
