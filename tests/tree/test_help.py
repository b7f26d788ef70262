"""help() and inspect show what the stubs say of native methods, which is compiled into the module.

What docstrings must contain is a check of ``make lint``: ``scripts/checks/docstrings.py``.
"""

from __future__ import annotations

import ast
import inspect
import pydoc

import pytest

import zenoh_tf
from scripts.checks.public_members import Member, class_of, functions, members
from scripts.checks.repository import Repository


def test_help_shows_native_methods() -> None:
    text = pydoc.plain(pydoc.render_doc(zenoh_tf.TransformTree))
    for part in ("lookup_transform(self, target: str", "ExtrapolationException", "nanoseconds"):
        assert part in text


def test_help_shows_what_editors_show() -> None:
    """The stubs' docstrings are compiled into the module: a stale build would differ."""
    for kind in (zenoh_tf._core.Tree, zenoh_tf.Transform, zenoh_tf.StampedTransform):
        _, stub = class_of(Repository(), kind)
        for name, node in functions(stub).items():
            if text := ast.get_docstring(node):
                assert (inspect.getdoc(getattr(kind, name)) or "").endswith(text), name


NATIVE = [
    member
    for kind in (zenoh_tf._core.Tree, zenoh_tf.Transform, zenoh_tf.StampedTransform)
    for member in members(Repository(), kind)
    if not member.is_property
]


@pytest.mark.parametrize("member", NATIVE, ids=lambda member: member.name)
def test_signatures_are_those_of_the_stubs(member: Member) -> None:
    signature = inspect.signature(getattr(member.owner, member.name))
    parameters = dict(signature.parameters)
    parameters.pop("self", None)
    assert list(parameters) == member.parameters
    for name, default in member.defaults.items():
        assert parameters[name].default == ast.literal_eval(default)
    assert signature.return_annotation == member.returns


def test_bound_methods_and_classes_have_signatures() -> None:
    bound = inspect.signature(zenoh_tf.TransformTree().lookup_transform)
    assert list(bound.parameters) == ["target", "source", "stamp_ns", "timeout_s"]
    assert inspect.signature(zenoh_tf.Transform).parameters["translation"].default == (0, 0, 0)
    assert "max_frames" in inspect.signature(zenoh_tf.TransformTree).parameters
    with pytest.raises(ValueError, match="no signature"):  # internal: its columns have no text
        inspect.signature(zenoh_tf._core.Tree._read_rows)
