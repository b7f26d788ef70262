"""Prints the table of docs/reference/api/README.md: ``python -m scripts.api_names``.

The pages of that folder name what they document, as in ``::: zenoh_tf.Transform``, and only the
site has the text. The table says in which file a reader of a checkout finds it.
"""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs/reference/api"
#: The class whose methods the clients have as well.
METHODS_OF = "zenoh_tf.TransformTree"
#: The native classes that it inherits from, in the stubs.
NATIVE_TREE = ("Tree", "Reads")


def table() -> Iterator[str]:
    """The lines of the table, in the order of the pages' names."""
    yield "| name | file | what it is |"
    yield "|---|---|---|"
    for page in sorted(FOLDER.glob("*.md")):
        for name in re.findall(r"^::: (\S+)$", page.read_text(), re.M):
            found = _resolve(name)
            yield _row(f"[`{name}`]({page.name})", found)
            if name == METHODS_OF:
                for method, function in inspect.getmembers(found, inspect.isroutine):
                    if not method.startswith("_"):
                        yield _row(f"`{found.__name__}.{method}`", function)


def _row(name: str, found: Any) -> str:
    found = inspect.unwrap(found)
    native = getattr(found, "__module__", "").startswith("zenoh_tf._core")
    path, text = _in_stubs()[found.__name__] if native else _in_source(found)
    return f"| {name} | `{path.relative_to(ROOT)}` | {_first_sentence(text)} |"


def _in_source(found: Any) -> tuple[Path, str]:
    return Path(inspect.getfile(found)), inspect.getdoc(found) or ""


@functools.cache
def _in_stubs() -> dict[str, tuple[Path, str]]:
    """The file and the text of each native class, and of each method of the native tree."""
    found = {}
    for path in (
        ROOT / "zenoh_tf/_core.pyi",
        *sorted((ROOT / "zenoh_tf/_core_stubs").glob("*.pyi")),
    ):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                methods = node.body if node.name in NATIVE_TREE else ()
                for each in (node, *methods):
                    if isinstance(each, ast.ClassDef | ast.FunctionDef):
                        found[each.name] = path, ast.get_docstring(each) or ""
    return found


def _resolve(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return getattr(importlib.import_module(module), attribute)


def _first_sentence(text: str) -> str:
    paragraph = " ".join(text.partition("\n\n")[0].split())
    sentence = re.split(r"(?<=[^.])[.:](?:\s|$)", paragraph)[0]
    return sentence.replace("|", "\\|").replace("``", "`") + "."


if __name__ == "__main__":
    print(*table(), sep="\n")
