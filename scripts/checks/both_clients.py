"""The asynchronous client has the synchronous one's methods: names, arguments, results, docs."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import zenoh_tf_client as client

from .. import sync_client
from .public_members import Member, members
from .repository import Repository, Violation

PAIRS: list[tuple[type, type]] = [
    (client.TransformClient, client.AsyncTransformClient),
    (client.Transaction, client.AsyncTransaction),
    (client.Batch, client.AsyncBatch),
    (client.Broadcaster, client.AsyncBroadcaster),
    (client.Watch, client.AsyncWatch),
]
#: These ask nobody.
PLAIN = {
    "AsyncTransformClient": {
        *("batch", "transaction", "gate", "endpoint", "tree", "reads", "last_receipt"),
        "replica_age_s",
    },
    "AsyncTransaction": {"set_transform", "set_transforms_xact"},
    "AsyncBroadcaster": {"authority"},
}
#: Their docstrings say what the event loop changes.
OWN_DOCS = {
    *("batch", "broadcaster", "close", "connect", "gate", "instance", "mirror", "reads"),
    *("run_transaction", "transaction", "watch"),
}


def plain(text: str) -> str:
    """Without what only the asynchronous client has, and without line breaks."""
    text = re.sub(r"\bawait |\basync |\bAsync(?=[A-Z])|Awaitable\[(?=T\])", "", text)
    text = re.sub(r"\((t[fx]\.\w+\((?:[^()]|\([^()]*\))*\))\)(?=\.)", r"\1", text)
    return " ".join(text.split())


def both_clients(repository: Repository) -> Iterator[Violation]:
    """Each pair of classes has equal methods, up to `await`."""
    for old, new in PAIRS:
        before = {member.name: member for member in members(repository, old)}
        after = {member.name: member for member in members(repository, new)}
        for name in sorted(before.keys() ^ after.keys()):
            member = before.get(name) or after[name]
            problem = f"{old.__name__} or {new.__name__} has no {name}: add it"
            yield Violation(member.path, member.node.lineno, problem)
        for name in sorted(before.keys() & after.keys()):
            for problem in differences(before[name], after[name]):
                member = after[name]
                text = f"{new.__name__}.{name}: {problem} {old.__name__}.{name}'s"
                yield Violation(member.path, member.node.lineno, text)


def differences(old: Member, new: Member) -> Iterator[str]:
    owner, name = new.owner.__name__, new.name
    if arguments(old) != arguments(new):
        yield "its arguments differ from"
    if plain(new.returns) != plain(old.returns):
        yield "its result differs from"
    if re.search("Awaitable|Coroutine", new.returns):
        # A union with an awaitable would force callers to check which of both they have.
        yield "make it a coroutine function; its result is awaitable, unlike"
    if old.is_property != new.is_property:
        yield "make both methods or both properties; it differs from"
    is_plain = (owner == "AsyncBatch" and name != "send") or name in PLAIN.get(owner, ())
    if isinstance(new.node, ast.AsyncFunctionDef) is is_plain:
        yield "it waits and should not, or does not wait and should; see PLAIN, and"
    if name not in OWN_DOCS and plain(new.doc) != plain(old.doc):
        yield "its docstring differs from"


def arguments(member: Member) -> str:
    return plain(ast.unparse(member.node.args)).replace("T]]", "T]")


def made_files(repository: Repository) -> Iterator[Violation]:
    """The files that scripts/sync_client.py makes are current, and each of its rules applies."""
    try:
        for path, _ in sync_client.stale(repository.text):
            yield Violation(path, 1, "differs from what aio/ gives: run make format")
    except (sync_client.Unmade, SyntaxError) as error:
        yield Violation("scripts/sync_client.py", 1, str(error))
