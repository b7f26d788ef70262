"""The contracts of ``make lint`` find an import that is planted in a copy of the packages."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("zenoh_tf", "server", "client")
#: The finder of the editable install would find the original packages before the copy.
LINT = """
import sys
sys.meta_path[:] = [each for each in sys.meta_path if "ScikitBuild" not in type(each).__name__]
sys.path[:0] = [".", "server", "client"]
from importlinter.cli import lint_imports
sys.exit(lint_imports(config_filename="pyproject.toml", no_cache=True))
"""
SDK, TOOLS = "client/zenoh_tf_client", "client/zenoh_tf_tools"
SERVER = "server/zenoh_tf_server"


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages' Python files and the contracts."""
    folder = tmp_path_factory.mktemp("packages")
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name in FOLDERS:
        for path in (ROOT / name).rglob("*.py"):
            target = folder / path.relative_to(ROOT)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)
    return folder


def lint(folder: Path) -> str:
    """The report of all contracts."""
    return subprocess.run(
        [sys.executable, "-c", LINT], cwd=folder, capture_output=True, text=True, check=False
    ).stdout


def test_the_packages_keep_all_contracts(copy: Path) -> None:
    report = lint(copy)
    assert " 0 broken" in report, report


@pytest.mark.parametrize(
    ("path", "line", "contract"),
    [
        (f"{SDK}/session/access.py", "import zenoh_tf_server", "The packages"),
        (f"{SDK}/session/access.py", "import zenoh_tf_tools.stamps", "The packages"),
        ("zenoh_tf/_net/keys.py", "import zenoh_tf_client", "The packages"),
        (f"{SERVER}/limits.py", "from .streams import interests", "The server's folders"),
        (f"{SDK}/requests/columns.py", "from ..session import steps", "The SDK's folders"),
        (f"{SDK}/helpers.py", "", "The SDK's folders"),
        (f"{SDK}/session/retries.py", "from . import exchange", "No circles"),
        (f"{TOOLS}/viewer/source.py", "from ..cli import output", "The tools' folders"),
    ],
)
def test_a_planted_import_breaks_a_contract(
    copy: Path, path: str, line: str, contract: str
) -> None:
    file = copy / path
    before = file.read_text() if file.exists() else None
    future = "from __future__ import annotations\n"
    text = before or future
    file.write_text(text.replace(future, f"{future}{line}\n", 1))
    try:
        report = lint(copy)
    finally:
        if before is None:
            file.unlink()
        else:
            file.write_text(before)
    assert re.search(rf"^{contract}.* BROKEN( \(\d ignored imports?\))?$", report, re.M), report
