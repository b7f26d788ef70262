"""Makes classes whose methods only pass their arguments on; `sync_client.py` writes their files.

The signatures are those of the functions or methods that are called, so that these are written
once. Editors and the API reference read signatures from the source, so the methods have to be
there.
"""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

CLIENT = "client/zenoh_tf_client"


@dataclass(frozen=True)
class Delegate:
    """A file with one class.

    Args:
        head: The file's text up to the methods that are made.
        sources: By file the functions or methods to call.
        body: What the methods do; `{call}` stands for the call, `{module}` for its file.
        owner: The class whose method of the same name has the docstring.
        docs: By method what its docstring has behind the name of that method; by default a full
            stop.
        returns: What takes the place of the result's outer type, as `Handle` of `Request`; empty:
            nothing does. None: the result is that of what is called.
        is_async: Whether the methods are coroutine functions.
    """

    head: str
    sources: dict[str, tuple[str, ...]]
    body: str
    owner: str
    docs: Mapping[str, str] = field(default_factory=dict)
    returns: str | None = None
    is_async: bool = False

    def made(self, read: Callable[[str], str]) -> str:
        """The file's text, not formatted; `read` returns that of a path. Raises ValueError if what
        is to be called is not there."""
        methods, imports = [], set()
        for path, names in self.sources.items():
            tree = ast.parse(read(path))
            functions = {
                node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
            }
            if missing := set(names) - functions.keys():
                raise ValueError(f"{path} has no functions {sorted(missing)}")
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

    def _method(self, path: str, function: ast.FunctionDef) -> ast.stmt:
        """The method that calls a function."""
        arguments = function.args
        positional = [each for each in arguments.args if each.arg != "self"]
        passed = [
            *(each.arg for each in positional),
            *(f"{each.arg}={each.arg}" for each in arguments.kwonlyargs),
        ]
        module = path.rpartition("/")[2].partition(".")[0]
        body = self.body.format(module=module, call=f"{function.name}({', '.join(passed)})")
        doc = f"As `{self.owner}.{function.name}`{self.docs.get(function.name, '.')}"
        if "\n" in doc:
            doc = f"{textwrap.indent(doc, '    ').lstrip()}\n    "
        returns = function.returns
        if self.returns is not None and isinstance(returns, ast.Subscript):
            inner = returns.slice
            returns = ast.Subscript(ast.Name(self.returns), inner) if self.returns else inner
        kind = ast.AsyncFunctionDef if self.is_async else ast.FunctionDef
        return kind(
            name=function.name,
            args=ast.arguments(
                posonlyargs=[],
                args=[ast.arg("self"), *positional],
                kwonlyargs=arguments.kwonlyargs,
                kw_defaults=arguments.kw_defaults,
                defaults=arguments.defaults,
            ),
            body=[ast.Expr(ast.Constant(doc)), *ast.parse(body).body],
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

    def sample(
        self, target: str, source: str, stamps_ns: ArrayLike, *, max_gap_s: float | None = None
    ) -> Handle[TransformArray]:
        """As `TransformTree.sample`."""
        return self.lookup_transforms(target, source, stamps_ns, max_gap_s=max_gap_s)
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
        body="return self._record({module}.{call})",
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
            "zenoh_tf/_core.pyi": ("latest_common_time", "frames", "parent", "chain"),
            "zenoh_tf/tree.py": (
                *("lookup_transforms", "sample", "deskew", "lookup_velocity", "frame", "explain"),
            ),
        },
        body="return self._tree.{call}",
        owner="TransformTree",
        docs={"frames": ", in any order.", "frame": ", without the frame's last change."},
    ),
    f"{CLIENT}/aio/reads.py": Delegate(
        '''\
"""Reads of `AsyncTransformClient` that need nothing of their own."""

from __future__ import annotations

from zenoh_tf.shared_tree import AskServer, SharedTree

from ..requests import estimates, info, lookups
from .session.shared_reads import SharedReads


class AsyncReads:
    """A base of `AsyncTransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _reads: SharedReads
    #: The server's memory. Lookups there take so little time that every step before them counts.
    _tree: SharedTree
''',
        {
            f"{CLIENT}/requests/lookups.py": (
                *("can_transform", "lookup_transforms", "latest_common_time", "lookup_velocity"),
            ),
            f"{CLIENT}/requests/estimates.py": ("estimate_transform", "estimate_transforms"),
            f"{CLIENT}/requests/info.py": ("frame", "parent", "chain"),
        },
        body="""\
found = self._tree.{call}
if type(found) is not AskServer:
    return found
return await self._reads.ask(found, {module}.{call})
""",
        owner="TransformTree",
        docs={
            "can_transform": "; the server waits, up to 3600 s.",
            "lookup_transforms": ", in one request.",
            "estimate_transform": """\
; now is by the server's clock.

Raises:
    ServiceException: As for every call; see the class.

Example:
    ``X = (await tf.estimate_transform("map", "base", max_error_m=0.02)).transform``""",
            "estimate_transforms": """\
, in one request; now is by the server's clock.

Raises:
    ServiceException: As for every call; see the class.

Example:
    ``near = (await tf.estimate_transforms("map", arms, None)).error_m < 0.02``""",
        },
        returns="",
        is_async=True,
    ),
}
