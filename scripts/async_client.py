"""Makes the methods of the asynchronous client from those of the synchronous one.

python scripts/async_client.py            writes the files
python scripts/async_client.py --check    fails if a file differs from what would be written

The two clients differ in `await` and little else. Editors and the API reference read signatures
and docstrings from the source, so both have to be there.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

CLIENT = Path(__file__).resolve().parents[1] / "client/zenoh_tf_client"
#: From each is made the file of the same name in `aio/`.
FILES = (
    *("lookups.py", "writes.py", "introspection.py", "sensor_data.py"),
    *("transaction.py", "batch.py"),
)
#: Modules that the asynchronous client has of its own.
OWN = {r"session\.connection", r"session\.shared_reads"}
ARGUMENTS = r"\((?:[^()]|\([^()]*\))*\)"
REPLACEMENTS = [
    # Imports and names.
    (rf"^from \.(?!(?:{'|'.join(OWN)})\b)(?=\w)", "from .."),
    (r"^import time$", "import asyncio"),
    (r"^from collections.abc import Callable", "from collections.abc import Awaitable, Callable"),
    (r"\bClient(?=(Lookups|Writes|Introspection|SensorData)\b)", "Async"),
    (r"\b(TransformClient|Transaction|Batch)\b", r"Async\1"),
    (r"Callable\[\[AsyncTransaction\], T\]", "Callable[[AsyncTransaction], Awaitable[T]]"),
    (r"\b__(enter|exit)__\b", r"__a\1__"),
    # A synchronous client keeps the tree at hand, as the steps to it count there.
    (r"self\._tree\b", "self._reads.tree"),
    (r"^    #: The server's memory\..*\n    _tree: SharedTree\n", ""),
    (r"import AskServer, SharedTree$", "import AskServer"),
    (r"^        if found:$", "        if type(found) is not AskServer:"),
    # Calls that wait.
    (
        r"(?<!def )\bself\.(_connection\.call|_reads\.ask|_shared\.read_versions"
        r"|_read_versions|_read|_ancestors|_send|frames|commit|send|lookup_transforms)\(",
        r"await self.\1(",
    ),
    (r"\bwith (?=begin\()", "async with "),
    (r"return repeat\(", "return await repeat("),
    (r"= function\(", "= await function("),
    (r"transaction\.check_reads\(", "await transaction.check_reads("),
    (r"\btime\.sleep\(", "await asyncio.sleep("),
    # Examples in docstrings.
    (r"\bwith (?=tf\.)", "async with "),
    (r"^(\s+)def (?=move\(tx\))", r"\1async def "),
    (rf"\b(tf\.(?!batch|transaction)\w+{ARGUMENTS}|tx\.(?!set_)\w+{ARGUMENTS})", r"await \1"),
    (rf"(await t[fx]\.\w+{ARGUMENTS})(?=\.\w)", r"(\1)"),
    (r"Thread safety: one thread at a time", "Concurrency: one task at a time"),
]


def made_from(source: str, text: str) -> str:
    """The asynchronous file that is made from the synchronous one of this name and text."""
    for pattern, replacement in REPLACEMENTS:
        text = re.sub(pattern, replacement, text, flags=re.MULTILINE)
    lines = text.splitlines()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and _waits(node):
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line.replace("def ", "async def ", 1)
    first = next(number for number, line in enumerate(lines) if line.startswith("from __future__"))
    lines[first:first] = [f"# Made from {source} by scripts/async_client.py: edit that file.", ""]
    return _formatted("\n".join(lines) + "\n")


def _waits(function: ast.FunctionDef) -> bool:
    return function.name in ("__aenter__", "__aexit__") or any(
        isinstance(node, ast.Await | ast.AsyncWith) for node in ast.walk(function)
    )


def _formatted(text: str) -> str:
    ruff = Path(sys.executable).with_name("ruff")
    for command in (["check", "--select", "I", "--fix", "--quiet"], ["format"]):
        text = subprocess.run(
            [ruff, *command, "--stdin-filename", CLIENT / "aio/made.py", "-"],
            input=text,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        ).stdout
    return text


def main() -> int:
    stale = []
    for name in FILES:
        text, path = made_from(name, (CLIENT / name).read_text()), CLIENT / "aio" / name
        if not path.exists() or path.read_text() != text:
            stale.append(f"aio/{name}")
            if "--check" not in sys.argv:
                path.write_text(text)
    if "--check" in sys.argv and stale:
        print(f"run scripts/async_client.py: {', '.join(stale)} differ from their sources")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
