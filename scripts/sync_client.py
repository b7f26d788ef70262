"""Makes the synchronous client's files from those of the asynchronous one, by their syntax trees.

`make format` writes the files, with those of `delegates.py`, and `make lint` fails if one differs
from what would be written.

Editors and the API reference read signatures and docstrings from the source, so both clients have
to be there. Without `await` a coroutine function is a function, so this direction loses nothing.
Where the two have to differ, the asynchronous file has a branch, which costs nothing at run time:

    if True:  # asynchronous
        ...
    else:
        ...

`scripts/sync_texts.py` has the names and sentences that differ. A rule that no longer applies
anywhere is an error, as is anything asynchronous that is left.
"""

from __future__ import annotations

import ast
import functools
import io
import os
import re
import subprocess
import sys
import textwrap
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from . import delegates, sync_texts

ROOT = Path(__file__).resolve().parents[1]
CLIENT = "client/zenoh_tf_client"
#: By asynchronous file the synchronous one.
FILES = {f"aio/{source}.py": f"{target}.py" for source, target in sync_texts.FILES.items()}
#: What no synchronous file may have.
LEFT = re.compile(r"\b(await|async|asyncio|Async[A-Z]\w*|Awaitable|__a(enter|exit|iter)__)\b")
#: Code in a docstring: between backquotes, or after a prompt.
INLINE = re.compile(r"(``?)([^`]+)(\1)|(?m:^ *(?:>>>|\.\.\.) )(.*)()")


class Unmade(ValueError):
    """A file cannot be made, or a rule does not apply; the message says which."""


def made(read: Callable[[str], str]) -> dict[str, str]:
    """The text of each made file by its path; `read` returns that of a path."""
    applied: Counter[str] = Counter()
    texts = {path: _formatted(each.made(read)) for path, each in delegates.MADE.items()}
    for source, target in FILES.items():
        maker = _Maker(source, target, applied)
        path = f"{CLIENT}/{source}"
        texts[os.path.normpath(f"{CLIENT}/{target}")] = maker.made(texts.get(path) or read(path))
    rules = (
        *(*sync_texts.NAMES, *sync_texts.CALLS, *sync_texts.IN_THREAD, *sync_texts.SENTENCES),
        *(*sync_texts.MODULES, *(sync_texts.OWN_TEXTS.keys() - sync_texts.FILES.keys())),
    )
    unused = [rule for rule in rules if not applied[rule]]
    if unused:
        raise Unmade(f"scripts/sync_texts.py: these rules apply nowhere: {unused}")
    return texts


class _Maker:
    """Makes one file, and counts the rules that were applied."""

    def __init__(self, source: str, target: str, applied: Counter[str]) -> None:
        self._source = source
        self._target = target
        self._applied = applied

    def made(self, text: str) -> str:
        module = self._source.removeprefix("aio/").removesuffix(".py")
        for before, after in sync_texts.OWN_TEXTS.get(module, {}).items():
            if text.count(before) != 1:
                raise Unmade(f"{self._source} must have this text once: {before!r}")
            text = text.replace(before, after)
        text = self.code(_chosen(re.sub(r"(?m)^# Made by .*\n\n", "", text)))
        first = text.index("from __future__")
        line = f"# Made by scripts/sync_client.py from {CLIENT}/{self._source}: edit that.\n\n"
        text = _formatted(text[:first] + line + text[first:])
        if left := LEFT.search(text):
            line_number = text.count("\n", 0, left.start()) + 1
            raise Unmade(f"{self._target}:{line_number} would still have {left[0]!r}")
        return text

    def code(self, text: str) -> str:
        """A piece of code without what makes it asynchronous."""
        edits = _Edits(text)
        strings = []
        for node in ast.walk(edits.tree):
            if isinstance(node, ast.JoinedStr) or (
                isinstance(node, ast.Constant) and isinstance(node.value, str)
            ):
                strings.append(edits.span(node))
            self._edit(edits, node)
        outer = [each for each in strings if not any(_is_inside(each, other) for other in strings)]
        for start, end in outer:
            quotes = 3 * edits.text.startswith('"""', start)
            edits.replace(
                start + quotes, end - quotes, self.prose(edits.text[start + quotes : end - quotes])
            )
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            start = edits.offset(*token.start)
            if any(begin <= start < end for begin, end in outer):
                continue
            if token.type == tokenize.NAME:
                edits.replace(start, start + len(token.string), self._name(token.string))
            elif token.type == tokenize.COMMENT:
                edits.replace(start, start + len(token.string), self.prose(token.string))
        return edits.applied()

    def prose(self, text: str) -> str:
        """A docstring, message or comment; the code in it, too."""
        for before, after in sync_texts.SENTENCES.items():
            if before in text:
                self._applied[before] += 1
                text = text.replace(before, after)
        text = INLINE.sub(self._inline, text)
        paragraphs = re.split(r"(\n\s*\n)", text)
        text = "".join(self._paragraph(each) for each in paragraphs)
        return re.sub(r"\b\w+\b", lambda word: self._name(word[0]), text)

    def _inline(self, found: re.Match[str]) -> str:
        group = 2 if found[2] else 4
        start, end = (offset - found.start() for offset in found.span(group))
        return found[0][:start] + self._if_code(found[group] or "") + found[0][end:]

    def _paragraph(self, text: str) -> str:
        """An example of several lines, or prose, which is no code."""
        if "async " not in text and "await " not in text:
            return text
        dedented = textwrap.dedent(text)
        before = next(iter(text.splitlines())).removesuffix(next(iter(dedented.splitlines())))
        return textwrap.indent(self._if_code(dedented), before)

    def _if_code(self, text: str) -> str:
        if not re.search(r"\b(async|await)\b", text):
            return text
        body = " pass" if text.endswith(":") else ""
        try:
            return self.code(text + body).removesuffix(body)
        except (SyntaxError, tokenize.TokenError):  # prose
            return text

    def _name(self, name: str) -> str:
        if name in sync_texts.NAMES:
            self._applied[name] += 1
            return sync_texts.NAMES[name]
        return name.removeprefix("Async") if re.match("Async[A-Z]", name) else name

    def _edit(self, edits: _Edits, node: ast.AST) -> None:
        match node:
            case ast.AsyncFunctionDef() | ast.AsyncWith() | ast.AsyncFor():
                start, _ = edits.span(node)
                edits.replace(start, start + len("async "), "")
            case ast.Await(value=ast.Call(func=function, args=[call, *_])) if (
                ast.unparse(function) in sync_texts.IN_THREAD
            ):
                self._applied[ast.unparse(function)] += 1
                is_lambda = isinstance(call, ast.Lambda)
                kept = call.body if isinstance(call, ast.Lambda) else call
                edits.keep(node, kept, "" if is_lambda else "()")
            case ast.Await(value=value):
                start, _ = edits.span(node)
                edits.replace(start, edits.span(value)[0], "")
            case (
                ast.Attribute(value=ast.Await() as value)
                | ast.Subscript(value=ast.Await() as value)
            ):  # the brackets around it
                (start, _), (inner, end) = edits.span(node), edits.span(value)
                edits.replace(start, inner, "")
                edits.replace(end, edits.text.index(")", end) + 1, "")
            case ast.Subscript(value=ast.Name(id="Awaitable"), slice=inner_type):
                edits.keep(node, inner_type)
            case ast.Attribute() if (call_name := ast.unparse(node)) in sync_texts.CALLS:
                self._applied[call_name] += 1
                edits.replace(*edits.span(node), sync_texts.CALLS[call_name])
            case ast.Import(names=[ast.alias(name="asyncio")]):
                # What of both is not used is removed afterwards.
                edits.replace(*edits.span(node), "import time")
            case ast.ImportFrom(level=level) if level:
                start, _ = edits.span(node)
                end = edits.text.index(" import", start)
                edits.replace(start, end, f"from {self._module(node)}")

    def _module(self, node: ast.ImportFrom) -> str:
        """The module to import from in the synchronous file, which lies in another folder."""
        above = Path(self._source).parts[: -node.level]
        parts = [*above, *(node.module.split(".") if node.module else [])]
        moved = sync_texts.MODULES.get(".".join(parts))
        self._applied[".".join(parts)] += 1
        if moved is None and parts[0] == "aio":
            name = "/".join(parts[1:])
            moved = sync_texts.FILES.get(name, name).replace("/", ".")
        if moved is not None and moved.startswith("zenoh_tf."):
            return moved
        if moved is not None:
            parts = moved.split(".")
        folder = Path(self._target).parts[:-1]
        while folder and parts and folder[0] == parts[0]:
            folder, parts = folder[1:], parts[1:]
        return "." * (len(folder) + 1) + ".".join(parts)


class _Edits:
    """Replacements in a piece of code, by offsets."""

    def __init__(self, text: str) -> None:
        if not text.isascii():
            raise Unmade("only ASCII has the same offsets in a syntax tree")
        self.tree = ast.parse(text)
        self.text = text
        self._lines = [0]
        for line in self.text.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))
        self._edits: dict[tuple[int, int], str] = {}

    def offset(self, line: int, column: int) -> int:
        return self._lines[line - 1] + column

    def span(self, node: ast.AST) -> tuple[int, int]:
        assert isinstance(node, ast.stmt | ast.expr)
        assert node.end_lineno is not None and node.end_col_offset is not None
        return (
            self.offset(node.lineno, node.col_offset),
            self.offset(node.end_lineno, node.end_col_offset),
        )

    def replace(self, start: int, end: int, new: str) -> None:
        if start < end and self.text[start:end] != new:
            self._edits[start, end] = new

    def keep(self, node: ast.AST, part: ast.AST, suffix: str = "") -> None:
        """Keep a part of a node only, with `suffix` behind it."""
        (start, end), (inner_start, inner_end) = self.span(node), self.span(part)
        self.replace(start, inner_start, "")
        self.replace(inner_end, end, suffix)

    def applied(self) -> str:
        text, at = "", 0
        for (start, end), new in sorted(
            self._edits.items(), key=lambda one: (one[0][0], -one[0][1])
        ):
            if start < at:  # inside of what was replaced already
                continue
            text += self.text[at:start] + new
            at = end
        return text + self.text[at:]


def _is_inside(one: tuple[int, int], other: tuple[int, int]) -> bool:
    return one != other and other[0] <= one[0] and one[1] <= other[1]


def _chosen(text: str) -> str:
    """The text with the synchronous part of each branch, less indented."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.If(test=ast.Constant(value=True), orelse=chosen):
                pass
            case _:
                continue
        lines = text.splitlines(keepends=True)
        assert node.end_lineno is not None
        kept = []
        if chosen:
            first = chosen[0].lineno - 1
            while lines[first - 1].strip() != "else:":  # comments before the first statement
                first -= 1
            kept = lines[first : node.end_lineno]
        indent = " " * node.col_offset
        block = textwrap.indent(textwrap.dedent("".join(kept)), indent)
        return _chosen("".join([*lines[: node.lineno - 1], block, *lines[node.end_lineno :]]))
    return text


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
    for path, text in made(read).items():
        if read(path) != text:
            yield path, text


def main() -> None:
    def read(path: str) -> str:
        file = ROOT / path
        return file.read_text() if file.exists() else ""

    for path, text in stale(read):
        (ROOT / path).write_text(text)


if __name__ == "__main__":
    main()
