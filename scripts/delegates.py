"""Makes classes whose methods only pass their arguments on; `sync_client.py` writes their files.

The signatures are those of the functions or methods that are called, so that these are written
once. Editors and the API reference read signatures from the source, so the methods have to be
there.
"""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass

CLIENT = "client/zenoh_tf_client"


@dataclass(frozen=True)
class Delegate:
    """A file with one class.

    Args:
        head: The file's text up to the methods that are made.
        sources: By file the functions or methods to call.
        call: The method's result; `{call}` stands for the call, `{module}` for its file.
        owner: The class whose method of the same name has the docstring.
        returns: What takes the place of the result's outer type, as `Handle` of `Request`; None:
            the result is that of what is called.
    """

    head: str
    sources: dict[str, tuple[str, ...]]
    call: str
    owner: str
    returns: str | None = None

    def made(self, read: Callable[[str], str]) -> str:
        methods, imports = [], set()
        for path, names in self.sources.items():
            tree = ast.parse(read(path))
            functions = {
                node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
            }
            made = [self._method(path, functions[name]) for name in names]
            used = {
                node.id for each in made for node in ast.walk(each) if isinstance(node, ast.Name)
            }
            imports |= set(_imports(tree, used))
            methods += [ast.unparse(ast.fix_missing_locations(each)) for each in made]
        files = ", ".join(path.rpartition("/")[2] for path in self.sources)
        line = f"# Made by scripts/delegates.py from {files}: edit those.\n\n"
        future = "from __future__ import annotations\n"
        start, rest = self.head.split(future)
        parts = [start, line, future, "\n", *sorted(imports), rest]
        for method in methods:
            parts += ["\n", textwrap.indent(method, "    "), "\n"]
        return "".join(parts)

    def _method(self, path: str, function: ast.FunctionDef) -> ast.FunctionDef:
        """The method that calls a function."""
        arguments = function.args
        positional = [each for each in arguments.args if each.arg != "self"]
        passed = [
            *(each.arg for each in positional),
            *(f"{each.arg}={each.arg}" for each in arguments.kwonlyargs),
        ]
        module = path.rpartition("/")[2].partition(".")[0]
        call = self.call.format(module=module, call=f"{function.name}({', '.join(passed)})")
        returns = function.returns
        if self.returns is not None and isinstance(returns, ast.Subscript):
            returns = ast.Subscript(ast.Name(self.returns), returns.slice)
        return ast.FunctionDef(
            name=function.name,
            args=ast.arguments(
                posonlyargs=[],
                args=[ast.arg("self"), *positional],
                kwonlyargs=arguments.kwonlyargs,
                kw_defaults=arguments.kw_defaults,
                defaults=arguments.defaults,
            ),
            body=ast.parse(f'"""As `{self.owner}.{function.name}`."""\nreturn {call}').body,
            decorator_list=[],
            returns=returns,
        )


def _imports(tree: ast.Module, used: set[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names) | ast.ImportFrom(names=names):
                node.names = [each for each in names if (each.asname or each.name) in used]
                if node.names:
                    yield ast.unparse(node) + "\n"


MADE = {
    f"{CLIENT}/requests/batch_operations.py": Delegate(
        '''\
"""The operations that a `Batch` records, one method for each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

from . import estimates, info, lookups, writes
from .handle import Handle
from .request import Request

T = TypeVar("T")


class BatchOperations(ABC):
    """The base of `Batch`. Each method records that of `TransformClient` with the same name.

    It checks the arguments at once. The handle's `result()` returns what that method returns, and
    raises what it raises.
    """

    @abstractmethod
    def _record(self, request: Request[T]) -> Handle[T]:
        """Add a request to what the batch sends."""

    def sample(self, target: str, source: str, stamps_ns: ArrayLike) -> Handle[TransformArray]:
        """As `TransformTree.sample`."""
        return self.lookup_transforms(target, source, stamps_ns)
''',
        {
            f"{CLIENT}/requests/lookups.py": (
                *("lookup_transform", "lookup_transform_full", "can_transform"),
                *("lookup_latest_transform", "lookup_latest_transform_xact"),
                *("lookup_latest_transforms_xact", "lookup_transforms", "latest_common_time"),
                "lookup_velocity",
            ),
            f"{CLIENT}/requests/estimates.py": ("estimate_transform", "estimate_transforms"),
            f"{CLIENT}/requests/writes.py": ("set_transform", "set_transforms_xact"),
            f"{CLIENT}/requests/info.py": (
                *("frames", "frame", "authorities", "parent", "chain", "stats"),
            ),
        },
        call="self._record({module}.{call})",
        owner="TransformClient",
        returns="Handle",
    ),
    f"{CLIENT}/mirror/tree_reads.py": Delegate(
        '''\
"""The lookups of mirrors that are those of their tree."""

from __future__ import annotations

from abc import ABC, abstractmethod

from zenoh_tf import TransformTree


class TreeReads(ABC):
    """A base of `MirrorReads`."""

    @property
    @abstractmethod
    def _tree(self) -> TransformTree:
        """The tree. Raises ServerUnavailable if the mirror is closed."""
''',
        {
            "zenoh_tf/_core.pyi": ("latest_common_time", "parent", "chain"),
            "zenoh_tf/tree.py": (
                *("lookup_transforms", "sample", "deskew", "lookup_velocity", "explain"),
            ),
        },
        call="self._tree.{call}",
        owner="TransformTree",
    ),
}
