"""The public methods of the classes that users see, from their sources and stubs."""

from __future__ import annotations

import ast
import functools
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass

from .repository import Repository

AnyFunction = ast.FunctionDef | ast.AsyncFunctionDef
STUBS = ("zenoh_tf/_core.pyi", "zenoh_tf/_core_stubs/transform.pyi")


@dataclass(frozen=True)
class Member:
    """A public method or property."""

    owner: type
    node: AnyFunction
    path: str
    doc: str

    @property
    def name(self) -> str:
        return self.node.name

    @property
    def parameters(self) -> list[str]:
        arguments = self.node.args
        names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        return [name for name in names if name not in ("self", "cls")]

    @property
    def defaults(self) -> dict[str, str]:
        """The default of each parameter that has one."""
        arguments = self.node.args
        positional = [*arguments.posonlyargs, *arguments.args]
        last = positional[len(positional) - len(arguments.defaults) :]
        pairs = itertools.chain(
            zip(last, arguments.defaults, strict=True),
            zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True),
        )
        return {name.arg: ast.unparse(default) for name, default in pairs if default is not None}

    @property
    def returns(self) -> str:
        return ast.unparse(self.node.returns) if self.node.returns else "None"

    @property
    def is_property(self) -> bool:
        return any(ast.unparse(d) == "property" for d in self.node.decorator_list)

    def section(self, title: str) -> str:
        """The text of a section of the docstring; empty if there is none."""
        found = re.search(rf"^{title}:\n((?:[ ]+.*\n?|\n)+)", self.doc, re.M)
        return found[1] if found else ""


def class_of(repository: Repository, kind: type) -> tuple[str, ast.ClassDef]:
    """The file and the syntax tree of a class: of its stub if it is native."""
    source = f"{kind.__module__.replace('.', '/')}.py"
    for path in (*STUBS, source, f"client/{source}", f"server/{source}"):
        for node in parsed(repository.text(path)).body:
            if isinstance(node, ast.ClassDef) and node.name == kind.__name__:
                return path, node
    raise LookupError(f"no class {kind.__name__} in {source}")


@functools.cache
def parsed(text: str) -> ast.Module:
    return ast.parse(text)


def functions(node: ast.ClassDef) -> dict[str, AnyFunction]:
    """The functions in a class; of overloads the last one."""
    return {item.name: item for item in node.body if isinstance(item, AnyFunction)}


def members(repository: Repository, kind: type) -> Iterator[Member]:
    """The public methods and properties of a class, inherited ones included."""
    seen: set[str] = set()
    for base in kind.__mro__[:-1]:
        if base.__module__ in ("abc", "typing", "builtins"):
            continue
        path, node = class_of(repository, base)
        for name, function in functions(node).items():
            if not name.startswith("_") and name not in seen:
                seen.add(name)
                yield Member(kind, function, path, ast.get_docstring(function) or "")
