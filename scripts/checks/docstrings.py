"""Every public method answers help() and an editor: with its arguments, units, results, errors.

The rule: Google-style docstrings. Every parameter is named in `Args:`; there is a `Returns:`
section or a first line that begins with "Return", unless the result is None; `Raises:` stands
exactly where something can be raised. A method may refer to one of the same name instead: "As
`TransformClient.frames`". Then it explains only what differs.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import zenoh_tf
import zenoh_tf_client

from .public_members import Member, class_of, members
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
    zenoh_tf_client.AsyncMirror,
]
#: Methods that raise nothing of their own.
RAISE_NOTHING = {
    "TransformTree": {"authorities", "clear", "reset", "frames", "stats"},
    "Transform": {"identity", "inverse", "matrix", "pose", "rpy"},
    "TransformArray": {"inverse"},
    "TransformClient": {"batch", "close", "transaction"},
    "Broadcaster": {"close"},
    "Mirror": {"close"},
}
RAISE_NOTHING |= {
    f"Async{name}": RAISE_NOTHING[name] for name in ("TransformClient", "Broadcaster", "Mirror")
}
#: What parameters and results of these names are measured in.
UNITS = {r"\w+_ns": "nanosecond", r"\w+_s": "second", r"stamped|translation|points": "metre"}
RESULTS = {"StampedTransform": "metre", "Velocity": "m/s"}


def docstrings(repository: Repository) -> Iterator[Violation]:
    """Public classes and methods have docstrings that follow the rule."""
    public = {
        kind.__name__: {each.name: each for each in members(repository, kind)} for kind in CLASSES
    }
    for kind in CLASSES:
        path, node = class_of(repository, kind)
        if not ast.get_docstring(node):
            yield Violation(path, node.lineno, f"{kind.__name__} has no docstring")
        for member in public[kind.__name__].values():
            found = re.match(r"As `(\w+)\.(\w+)`", member.doc)
            if found:
                referred = public.get(found[1], {}).get(found[2])
                all_problems = reference_problems(member, referred)
            else:
                all_problems = problems(member)
            for problem in all_problems:
                name = f"{kind.__name__}.{member.name}"
                yield Violation(member.path, member.node.lineno, f"{name}: {problem}")


def reference_problems(member: Member, referred: Member | None) -> Iterator[str]:
    """A method that refers to another one explains only the arguments that are its own."""
    if referred is None or referred.name != member.name:
        yield "refer to a public method of the same name"
        return
    arguments = member.section("Args")
    for name in member.parameters:
        if name in referred.parameters:
            if member.defaults.get(name) != referred.defaults.get(name):
                yield f"the default of {name!r} differs from that of {referred.owner.__name__}"
        elif not re.search(rf"^\s+{name}: \S", arguments, re.M):
            yield f"explain {name!r} in Args"
    order = [name for name in referred.parameters if name in member.parameters]
    if order != [name for name in member.parameters if name in order]:
        yield f"its arguments have another order than those of {referred.owner.__name__}"


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
