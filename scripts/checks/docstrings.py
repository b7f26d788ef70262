"""Every public method answers help() and an editor: with its arguments, units, results, errors.

The rule: Google-style docstrings. Every parameter is named in `Args:`; there is a `Returns:`
section or a first line that begins with "Return", unless the result is None; `Raises:` stands
exactly where something can be raised.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import zenoh_tf
import zenoh_tf_client

from .public_members import REFERRING, Member, class_of, functions, members
from .repository import Repository, Violation

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


def docstrings(repository: Repository) -> Iterator[Violation]:
    """Public classes and methods have docstrings that follow the rule."""
    for kind in CLASSES:
        path, node = class_of(repository, kind)
        if not ast.get_docstring(node):
            yield Violation(path, node.lineno, f"{kind.__name__} has no docstring")
        for member in members(repository, kind):
            for problem in problems(member):
                name = f"{kind.__name__}.{member.name}"
                yield Violation(member.path, member.node.lineno, f"{name}: {problem}")


def problems(member: Member) -> Iterator[str]:
    if not member.doc:
        yield "write a docstring"
        return
    if not re.search(r"[.:]$", member.doc.splitlines()[0]):
        yield "let the docstring begin with a sentence on one line"
    if not member.is_property:
        arguments = member.section("Args")
        for name in member.parameters:
            if not re.search(rf"^\s+\*{{0,2}}{name}: \S", arguments, re.M):
                yield f"explain {name!r} in Args"
        has_result = member.returns not in ("None", "Self")
        if has_result and not member.section("Returns") and not re.match("Returns? ", member.doc):
            yield "say what it returns"
        yield from raises_problems(member)
    for name in [*member.parameters, member.name]:
        for pattern, unit in UNITS.items():
            if re.fullmatch(pattern, name) and unit not in member.doc.lower():
                yield f"say that {name!r} is in {unit}s"
    for result, unit in RESULTS.items():
        if result in re.findall(r"\w+", member.returns) and unit not in member.doc.lower():
            yield f"say the unit of the {result}: {unit}"


def raises_problems(member: Member) -> Iterator[str]:
    raises = member.section("Raises")
    if member.name in RAISE_NOTHING.get(member.owner.__name__, ()):
        if raises:
            yield "it is in RAISE_NOTHING, but lists errors in Raises"
        return
    if not raises:
        yield "list its errors in Raises"
    for name in re.findall(r"^ {4}(\w+): \S", raises, re.M):
        if not hasattr(zenoh_tf, name) and not name.endswith("Error"):
            yield f"Raises names {name}, which is no error"


def references(repository: Repository) -> Iterator[Violation]:
    """A mirror's methods refer to the embedded tree's, and have their arguments."""
    path, node = class_of(repository, REFERRING)
    own = {member.name: member for member in members(repository, zenoh_tf.TransformTree)}
    for name, function in functions(node).items():
        if name.startswith("_"):
            continue
        if not (ast.get_docstring(function) or "").startswith(f"As `TransformTree.{name}`"):
            problem = f"{name}: let the docstring begin with: As `TransformTree.{name}`"
            yield Violation(path, function.lineno, problem)
        if ast.unparse(function.args) != ast.unparse(own[name].node.args):
            problem = f"{name}: its arguments differ from TransformTree.{name}'s"
            yield Violation(path, function.lineno, problem)
