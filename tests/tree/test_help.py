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
    """nanobind keeps them as text, which `help` shows."""
    native = getattr(member.owner, member.name)
    ((text, _, _),) = native.__nb_signature__
    parameters = [*ast.parse(f"{text}: ...").body]
    (function,) = parameters
    assert isinstance(function, ast.FunctionDef)
    named = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    assert [each.arg for each in named if each.arg != "self"] == member.parameters
    first_line = pydoc.plain(pydoc.render_doc(native)).split("\n\n")[1]
    assert all(name in first_line for name in member.parameters)


def test_the_library_leaves_types_alone() -> None:
    """The types of nanobind are those of every module of this process that is made with it."""
    for kind in (type(zenoh_tf._core.decoded_size), type(zenoh_tf.Transform.inverse)):
        assert "__signature__" not in vars(kind)
