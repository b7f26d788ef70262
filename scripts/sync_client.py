"""Makes the synchronous client's files from those of the asynchronous one, by a few replacements.

`make format` writes the files, and `make lint` fails if one differs from what would be written.
Editors and the API reference read signatures and docstrings from the source, so both clients have
to be there. Docstrings are written to suit both.
"""

from __future__ import annotations

import functools
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CLIENT = "client/zenoh_tf_client"
#: What of `aio/` has a synchronous file of the same name.
FILES = ("lookups", "writes", "introspection", "transaction", "batch")
REPLACEMENTS = (
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\bawait ", ""),
    (r"\bAwaitable\[(\w+)\]", r"\1"),
    (r"\b__a(enter|exit)__", r"__\1__"),
    (r"\b(an|An) (`*)Async", lambda found: f"{found[1][0]} {found[2]}"),
    (r"\bAsync(?=[A-Z])", ""),
    (r"\basyncio\b", "time"),
    (r"\b_connection\.opened\b", "_connection"),
    (r"(?m)^from \.\.(?=\.*\w)", "from ."),
)
#: What no synchronous file may have.
LEFT = re.compile(r"\b(await|async|asyncio|Async[A-Z]\w*|Awaitable|__a(enter|exit|iter)__)\b")


def made(read: Callable[[str], str]) -> Iterator[tuple[str, str]]:
    """The path and the text of each made file; `read` returns that of a path."""
    for name in FILES:
        source = f"{CLIENT}/aio/{name}.py"
        text = read(source)
        for pattern, replacement in REPLACEMENTS:
            text = re.sub(pattern, replacement, text)
        line = f"# Made by scripts/sync_client.py from {source}: edit that.\n\n"
        text = _formatted(text.replace("from __future__", f"{line}from __future__", 1))
        if left := LEFT.search(text):
            raise ValueError(f"{CLIENT}/{name}.py would still have {left[0]!r}")
        yield f"{CLIENT}/{name}.py", text


@functools.cache
def _formatted(text: str) -> str:
    ruff = Path(sys.executable).with_name("ruff")
    for command in (["check", "--select", "I,F401", "--fix", "--quiet"], ["format"]):
        text = subprocess.run(
            [ruff, *command, "--stdin-filename", ROOT / CLIENT / "made.py", "-"],
            input=text,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        ).stdout
    return text


def stale(read: Callable[[str], str]) -> Iterator[tuple[str, str]]:
    """The path and the text of each file that differs from what it would be."""
    return ((path, text) for path, text in made(read) if read(path) != text)


def main() -> None:
    def read(path: str) -> str:
        file = ROOT / path
        return file.read_text() if file.exists() else ""

    for path, text in stale(read):
        (ROOT / path).write_text(text)


if __name__ == "__main__":
    main()
