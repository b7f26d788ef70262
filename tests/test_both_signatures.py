"""The asynchronous client has the synchronous one's methods: names, arguments, results, docs."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from zenoh_tf_client import (
    AsyncBatch,
    AsyncBroadcaster,
    AsyncTransaction,
    AsyncTransformClient,
    Batch,
    Broadcaster,
    Transaction,
    TransformClient,
)

ROOT = Path(__file__).resolve().parent.parent
PAIRS: list[tuple[type, type]] = [
    (TransformClient, AsyncTransformClient),
    (Transaction, AsyncTransaction),
    (Batch, AsyncBatch),
    (Broadcaster, AsyncBroadcaster),
]
#: These ask nobody.
PLAIN = {
    AsyncTransformClient: {
        *("batch", "transaction", "gate", "endpoint", "tree", "reads", "last_receipt"),
        "replica_age_s",
    },
    AsyncTransaction: {"set_transform", "set_transforms_xact"},
    AsyncBroadcaster: {"authority"},
}
#: Their docstrings say what the event loop changes.
OWN_DOCS = {
    *("batch", "broadcaster", "close", "connect", "gate", "instance", "mirror", "reads"),
    *("run_transaction", "transaction", "watch"),
}

MEMBERS = [
    (old, new, name)
    for old, new in PAIRS
    for name in sorted({*dir(old), *dir(new)})
    if not name.startswith("_")
]


def function(kind: type, name: str) -> Any:
    found = inspect.getattr_static(kind, name)
    if isinstance(found, property):
        return found.fget
    return getattr(found, "__func__", found)


def plain(text: str) -> str:
    """Without what only the asynchronous client has, and without line breaks."""
    text = re.sub(r"\bawait |\basync |\bAsync(?=[A-Z])|Awaitable\[(?=T\])", "", text)
    text = re.sub(r"\((t[fx]\.\w+\((?:[^()]|\([^()]*\))*\))\)(?=\.)", r"\1", text)
    return " ".join(text.split())


@pytest.mark.parametrize(("old", "new", "name"), MEMBERS)
def test_names_arguments_and_results(old: type, new: type, name: str) -> None:
    before, after = inspect.signature(function(old, name)), inspect.signature(function(new, name))
    assert list(before.parameters) == list(after.parameters)
    for argument, there in before.parameters.items():
        here = after.parameters[argument]
        assert (here.kind, here.default) == (there.kind, there.default)
        assert plain(str(here.annotation)).replace("T]]", "T]") == plain(str(there.annotation))
    assert plain(str(after.return_annotation)) == plain(str(before.return_annotation))


@pytest.mark.parametrize(("old", "new", "name"), MEMBERS)
def test_what_waits_is_a_coroutine(old: type, new: type, name: str) -> None:
    is_recorded = new is AsyncBatch and name != "send"
    is_plain = is_recorded or name in PLAIN.get(new, ())
    assert inspect.iscoroutinefunction(function(new, name)) is not is_plain
    assert isinstance(inspect.getattr_static(old, name), property) is isinstance(
        inspect.getattr_static(new, name), property
    )


@pytest.mark.parametrize(
    ("old", "new", "name"), [member for member in MEMBERS if member[2] not in OWN_DOCS]
)
def test_docstrings_say_the_same(old: type, new: type, name: str) -> None:
    assert plain(inspect.getdoc(function(new, name)) or "") == plain(
        inspect.getdoc(function(old, name)) or ""
    )


def test_no_result_may_be_awaited_or_not() -> None:
    """A union with an awaitable would force callers to check which of both they have."""
    for _, new, name in MEMBERS:
        result = str(inspect.signature(function(new, name)).return_annotation)
        assert "Awaitable" not in result and "Coroutine" not in result


def test_the_made_files_are_current() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "scripts/async_client.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "")
