"""``zenoh-tf explain``: why a lookup succeeds or fails."""

from __future__ import annotations

import argparse

from zenoh_tf import Explanation, TransformException
from zenoh_tf.text import printable
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands, add_frames
from zenoh_tf_tools.cli.tree import estimate
from zenoh_tf_tools.cli.tree.lookups import tree_at
from zenoh_tf_tools.errors import FAULT_FOUND
from zenoh_tf_tools.estimate_words import bounds

#: A bound that is smaller needs no advice.
_WORTH_M = 0.005


def add(commands: Commands) -> None:
    explain = commands.add(
        "explain",
        _explain,
        "say why a lookup fails or is old, and what to do",
        "Print the chain between two frames link by link, read at one instant, which link limits "
        "the lookup, why it fails if it does, and what to do; also how well the pose is known now, "
        "and what would make that better. With FILE: a lookup in a recording. Exit code 3 if it "
        "fails.",
        "zenoh-tf explain map camera",
        "zenoh-tf explain map camera --at now-0.5s",
        "zenoh-tf explain run.mcap map camera --at +10s",
    )
    recorded.add_optional_file(explain)
    add_frames(explain)
    recorded.add_at(explain)


def _explain(args: argparse.Namespace) -> int:
    with tree_at(args) as (tree, stamp_ns):
        found = tree.explain(args.target, args.source, stamp_ns)
        now = _now(tree, found) if isinstance(tree, TransformClient) else None
    document = found.document() | ({} if now is None else {"now": now[0]})
    text = found.text(output.paint)
    output.show(args, document, text if now is None else f"{text}\n\n{now[1]}")
    return 0 if found.possible else FAULT_FOUND


def _now(tf: TransformClient, found: Explanation) -> tuple[dict[str, object], str] | None:
    """How well the pose is known now, and what would make that better; None if nothing moves, or
    it is unknown."""
    if found.stamp_ns is not None or not found.possible:  # the question is about another time
        return None
    if not found.by_clock or all(link.static for link in found.links):
        return None
    try:
        answer = tf.estimate_transform(found.target, found.source)
    except TransformException:
        return None
    if answer.basis == "backtest" and not answer.backtests:  # a bound that rests on nothing
        return None
    better = (estimate.advice(tf, answer) or "") if answer.error_m >= _WORTH_M else ""
    text = f"Estimated for now, it is {bounds(answer)}. {better}"
    return estimate.document(answer) | {"advice": better}, printable(text.rstrip())
