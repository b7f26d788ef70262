"""Every public method answers help() and an editor: with its arguments, units, results, errors.

The rule: Google-style docstrings. Every parameter is named in `Args:`; there is a `Returns:`
section or a first line that begins with "Return", unless the result is None; `Raises:` stands
exactly where something can be raised.
"""

from __future__ import annotations

import ast
import inspect
import pydoc
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import zenoh_tf
import zenoh_tf_client

CLASSES: list[type] = [
    zenoh_tf.TransformTree,
    zenoh_tf.Transform,
    zenoh_tf.StampedTransform,
    zenoh_tf.LatestTransform,
    zenoh_tf.TransformArray,
    zenoh_tf_client.TransformClient,
    zenoh_tf_client.Broadcaster,
    zenoh_tf_client.Transaction,
    zenoh_tf_client.Batch,
    zenoh_tf_client.Mirror,
    zenoh_tf_client.AsyncTransformClient,
    zenoh_tf_client.AsyncBroadcaster,
    zenoh_tf_client.AsyncTransaction,
    zenoh_tf_client.AsyncBatch,
]
#: A base whose methods refer to those of the same names in another class.
REFERS = {zenoh_tf_client.mirror_reads.MirrorReads: zenoh_tf.TransformTree}
STUBS = [Path(zenoh_tf.__file__).with_name(name) for name in ("_core.pyi", "_transform.pyi")]

#: Methods that raise nothing of their own.
RAISE_NOTHING = {
    "TransformTree": {"authorities", "clear", "reset", "frames", "stats"},
    "Transform": {"identity", "inverse", "matrix", "pose", "rpy"},
    "TransformArray": {"inverse"},
    "TransformClient": {"batch", "close", "transaction"},
    "Broadcaster": {"close"},
    "Mirror": {"close"},
    # Only recorded: the handle raises.
    "Batch": {
        *("authorities", "chain", "frame", "frames", "latest_common_time", "parent", "stats"),
        *("lookup_latest_transform", "lookup_latest_transform_xact"),
        *("lookup_latest_transforms_xact", "set_transform", "set_transforms_xact"),
    },
}
RAISE_NOTHING |= {f"Async{name}": RAISE_NOTHING[name] for name in ("Broadcaster", "Batch")}
RAISE_NOTHING["AsyncTransformClient"] = RAISE_NOTHING["TransformClient"]
#: What parameters and results of these names are measured in.
UNITS = {r"\w+_ns": "nanosecond", r"\w+_s": "second", r"stamped|translation|points": "metre"}
RESULTS = {"StampedTransform": "metre", "Velocity": "m/s"}

AnyFunction = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Member:
    """A public method or property, with its signature as a syntax tree."""

    owner: type
    name: str
    node: AnyFunction
    doc: str

    @property
    def parameters(self) -> list[str]:
        arguments = self.node.args
        names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        return [name for name in names if name not in ("self", "cls")]

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


def stub_class(name: str) -> ast.ClassDef | None:
    for stub in STUBS:
        for node in ast.parse(stub.read_text()).body:
            if isinstance(node, ast.ClassDef) and node.name == name:
                return node
    return None


def functions(kind: type) -> dict[str, AnyFunction]:
    """The functions in a class's source, or in its stub if it is native."""
    node = stub_class(kind.__name__)
    if node is None:
        tree = ast.parse(inspect.getsource(kind))
        assert isinstance(tree.body[0], ast.ClassDef)
        node = tree.body[0]
    return {item.name: item for item in node.body if isinstance(item, AnyFunction)}


def members(kind: type) -> Iterator[Member]:
    seen = set()
    for base in kind.__mro__[:-1]:
        if base in REFERS or base.__module__ == "abc":
            continue
        nodes = functions(base)
        for name, value in vars(base).items():
            is_field = inspect.isdatadescriptor(value) and not isinstance(value, property)
            if name.startswith("_") or name in seen or is_field:
                continue
            seen.add(name)
            function = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
            doc = inspect.getdoc(function) or ""
            if stub_class(base.__name__) and name in nodes and not isinstance(value, property):
                first, _, doc = doc.partition("\n\n")  # nanobind puts the signature first
                assert first.startswith(f"{name}("), first
            yield Member(kind, name, nodes[name], doc)


ALL = [member for kind in CLASSES for member in members(kind)]
METHODS = [member for member in ALL if not member.is_property]


def ids(member: Member) -> str:
    return f"{member.owner.__name__}.{member.name}"


def test_all_methods_are_looked_at() -> None:
    names = {ids(member) for member in ALL}
    for name in (
        "TransformTree.lookup_transform",  # native, inherited
        "TransformTree.sample",
        "Transform.from_rpy",  # static
        "Transform.translation",  # a property
        "LatestTransform.parent_frame",
        "TransformArray.raise_for_status",
        "TransformClient.connect",  # a class method
    ):
        assert name in names


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_classes_are_documented(kind: type) -> None:
    assert kind.__doc__
    assert all(kind.__doc__ != base.__doc__ for base in kind.__mro__[1:])


@pytest.mark.parametrize("member", ALL, ids=ids)
def test_docstrings_are_their_own(member: Member) -> None:
    assert member.doc.strip(), "no docstring"
    assert member.doc != getattr(object, member.name, None).__doc__
    assert re.search(r"[.:]$", member.doc.strip().splitlines()[0]), "no first sentence"


@pytest.mark.parametrize("member", METHODS, ids=ids)
def test_every_parameter_is_explained(member: Member) -> None:
    arguments = member.section("Args")
    for name in member.parameters:
        assert re.search(rf"^\s+\*{{0,2}}{name}: \S", arguments, re.M), f"{name} is not in Args"


@pytest.mark.parametrize("member", METHODS, ids=ids)
def test_results_are_explained(member: Member) -> None:
    if member.returns not in ("None", "Self"):
        assert member.section("Returns") or re.match("Returns? ", member.doc), "no Returns"


@pytest.mark.parametrize("member", METHODS, ids=ids)
def test_errors_are_listed(member: Member) -> None:
    raises = member.section("Raises")
    if member.name in RAISE_NOTHING.get(member.owner.__name__, ()):
        assert not raises
        return
    assert raises, "no Raises"
    for name in re.findall(r"^ {4}(\w+): \S", raises, re.M):
        assert hasattr(zenoh_tf, name) or name.endswith("Error"), f"no error {name}"


@pytest.mark.parametrize("member", ALL, ids=ids)
def test_units_are_named(member: Member) -> None:
    for name in [*member.parameters, member.name]:
        for pattern, unit in UNITS.items():
            if re.fullmatch(pattern, name):
                assert unit in member.doc.lower(), f"{name}: no {unit}s"
    for kind, unit in RESULTS.items():
        if kind in re.findall(r"\w+", member.returns):
            assert unit in member.doc.lower(), f"a {kind} without {unit}"


@pytest.mark.parametrize(("base", "other"), REFERS.items())
def test_methods_that_refer_to_another_class(base: type, other: type) -> None:
    own = {member.name: member for member in members(other)}
    for name, node in functions(base).items():
        if not name.startswith("_"):
            doc = ast.get_docstring(node) or ""
            assert doc.startswith(f"As `{other.__name__}.{name}`"), name
            assert ast.unparse(node.args) == ast.unparse(own[name].node.args), name


def test_help_shows_native_methods() -> None:
    text = pydoc.plain(pydoc.render_doc(zenoh_tf.TransformTree))
    for part in ("lookup_transform(self, target: str", "ExtrapolationException", "nanoseconds"):
        assert part in text


def test_help_shows_what_editors_show() -> None:
    """The stubs' docstrings are compiled into the module: a stale build would differ."""
    for kind in (zenoh_tf._core.Tree, zenoh_tf.Transform, zenoh_tf.StampedTransform):
        for name, node in functions(kind).items():
            if text := ast.get_docstring(node):
                assert (inspect.getdoc(getattr(kind, name)) or "").endswith(text), name
