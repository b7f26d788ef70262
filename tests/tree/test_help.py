"""help() shows the documentation of native methods, which is compiled into the module.

What docstrings must contain is a check of ``make lint``: ``scripts/checks/docstrings.py``.
"""

from __future__ import annotations

import ast
import inspect
import pydoc

import zenoh_tf
from scripts.checks.public_members import class_of, functions
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
