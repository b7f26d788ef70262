"""help() and inspect show what the stubs say of native methods: it is compiled into the module."""

from __future__ import annotations

import ast
import inspect
import pydoc
from pathlib import Path

import pytest

import zenoh_tf

LIBRARY = Path(zenoh_tf.__file__).parent
STUBS = [LIBRARY / "_core.pyi", *(LIBRARY / "_core_stubs").glob("*.pyi")]
CLASSES = {name: name for name in ("Tree", "Transform", "StampedTransform")} | {"Reads": "Tree"}
#: The methods of the stubs, by class and name; of overloads the last one.
NATIVE = {
    (CLASSES[node.name], method.name): method
    for stub in STUBS
    for node in ast.parse(stub.read_text()).body
    if isinstance(node, ast.ClassDef) and node.name in CLASSES
    for method in node.body
    if isinstance(method, ast.FunctionDef)
}


def test_help_shows_native_methods() -> None:
    text = pydoc.plain(pydoc.render_doc(zenoh_tf.TransformTree))
    for part in ("lookup_transform(self, target: str", "ExtrapolationException", "nanoseconds"):
        assert part in text


def test_help_shows_what_editors_show() -> None:
    """The stubs' docstrings are compiled into the module: a stale build would differ."""
    for (owner, name), node in NATIVE.items():
        if text := ast.get_docstring(node):
            native = getattr(getattr(zenoh_tf._core, owner), name)
            assert (inspect.getdoc(native) or "").endswith(text), name


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (owner, name)
        for (owner, name), node in NATIVE.items()
        if not name.startswith("_") and not node.decorator_list
    ],
)
def test_signatures_are_those_of_the_stubs(owner: str, name: str) -> None:
    """nanobind keeps them as text, which `help` shows."""
    native = getattr(getattr(zenoh_tf._core, owner), name)
    ((text, _, _),) = native.__nb_signature__
    (function,) = ast.parse(f"{text}: ...").body
    assert isinstance(function, ast.FunctionDef)
    parameters = names(NATIVE[owner, name])
    assert names(function) == parameters
    first_line = pydoc.plain(pydoc.render_doc(native)).split("\n\n")[1]
    assert all(parameter in first_line for parameter in parameters)


def names(function: ast.FunctionDef) -> list[str]:
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return [each.arg for each in every if each.arg != "self"]


def test_the_library_leaves_types_alone() -> None:
    """The types of nanobind are those of every module of this process that is made with it."""
    for kind in (type(zenoh_tf._core.decoded_size), type(zenoh_tf.Transform.inverse)):
        assert "__signature__" not in vars(kind)
