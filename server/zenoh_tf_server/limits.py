"""Every limit of the server in one table, and the flags ``--limit`` and ``--max-memory``.

``python -m zenoh_tf_server.limits`` prints the tables of docs/reference/limits.md.
"""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from typing import Final

from zenoh_tf import wire
from zenoh_tf._core import Budget
from zenoh_tf.errors import LimitExceeded
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import size

#: The only limit with a flag of its own, which also accepts a unit.
_MEMORY: Final = "memory"
#: No client accepts a larger reply.
_HIGHEST: Final = {"reply_bytes": wire.MAX_REPLY_BYTES}
#: Any other limit must fit into the native module's numbers.
_HIGHEST_OF_ALL: Final = 10**15
#: Names that a row may use: target, source and the fixed frame.
NAMES_PER_ROW: Final = 3


def _limit(default: int, meaning: str, when_hit: str, is_set: bool = True) -> int:
    about = {"meaning": meaning, "when_hit": when_hit, "is_set": is_set}
    value: int = field(default=default, metadata=about)
    return value


def _fixed(value: int, meaning: str, when_hit: str) -> int:
    """A limit that no operator needs to change: there is neither a flag nor a key for it."""
    return _limit(value, meaning, when_hit, is_set=False)


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of one server; ``--limit`` and the configuration file set those that are not
    fixed, by name."""

    frames: int = _limit(1 << 20, "frames in the tree", "a write that names a new frame is refused")
    samples_per_frame: int = _limit(
        1 << 16, "samples kept per frame, within the cache time", "the oldest samples are evicted"
    )
    memory: int = _limit(
        4 << 30,
        "bytes of all samples together (`--max-memory`)",
        "a write that needs more is refused",
    )
    rows: int = _limit(
        100_000,
        "lookups or transforms in one message, over all operations of a batch",
        "the request is refused, a put is dropped and counted",
    )
    message_bytes: int = _limit(
        16 << 20,
        "bytes of one message",
        "the request is refused, a put is dropped and counted; a message of more than four "
        "times as much closes its sender's connection",
    )
    decoded_bytes: int = _limit(
        48 << 20,
        "bytes of memory that one message takes when it is decoded",
        "the request is refused, a put is dropped and counted",
    )
    reply_bytes: int = _limit(
        32 << 20,
        "bytes of one reply",
        "the request is refused, or in a batch the operations whose replies have no room",
    )
    pending_queries: int = _limit(
        4096, "queries received but not yet started", "the query is refused with `ServerBusy`"
    )
    waiters: int = _limit(
        20_000,
        "lookups waiting for a transform (`timeout_s`); each row of a batch counts; a client may "
        "hold as many as are left free",
        "the lookup is refused with `ServerBusy`",
    )
    outcomes: int = _limit(
        200_000,
        "outcomes of writes, remembered until the write's expiry; a client may hold as many as "
        "are left free",
        "the write is refused with `ServerBusy`",
    )
    startup_ms: int = _limit(
        5000,
        "milliseconds after the server's start in which its publishers may not be back yet",
        "an unknown frame is `LookupException` again, no longer `ServerStarting`",
    )
    put_queue_bytes: int = _limit(
        32 << 20,
        "bytes of puts of one authority that wait to be committed",
        "its oldest dynamic put is dropped and counted; a static put that finds no room is refused",
    )
    put_wait_ms: int = _limit(
        250,
        "milliseconds that a dynamic put waits to be committed",
        "if puts of other authorities wait as long, it is dropped and counted; the newest of each "
        "authority stays",
    )
    stream_bytes: int = _limit(
        64 << 20,
        "bytes of the stream's latest messages, kept for mirrors that missed some",
        "the oldest is evicted, and a mirror that missed it loads a new snapshot",
    )
    interests: int = _limit(
        1024,
        "interests of mirrors (`tf.mirror(pairs)`, `max_rate_hz`), counted for each client; a "
        "client may hold as many as are left free",
        "the mirror is refused with `ServerBusy`",
    )
    interest_frames: int = _limit(
        200_000,
        "frames that mirrors with an interest have, summed over all interests; a client always "
        "has an equal share of them, and more while some are free",
        "a mirror above its client's share is refused with `ServerBusy`, or gets nothing more; "
        "one of more frames than the limit gets `LimitExceeded`",
    )
    connections: int = _limit(
        1200, "Zenoh connections to the embedded router", "the connection is refused"
    )
    robots: int = _limit(
        1200,
        "robots that `--mirror-of 'PATTERN'` finds until the server ends; they share the frames",
        "a further robot is left out, and named in the log",
    )

    name_bytes: int = _fixed(255, "UTF-8 bytes in a frame's name", "the request is refused")
    depth: int = _fixed(
        1000,
        "links between a frame and its root, and that a lookup follows from either frame",
        "a write whose child would be deeper is refused; a lookup in the past, or below a moved "
        "frame, fails",
    )
    links: int = _fixed(
        10_000_000,
        "links of the lookups of one message: the sum of both frames' depths over all rows",
        "the lookup is refused before it starts",
    )
    read_set: int = _fixed(
        1 << 19,
        "frames read by one lookup with `atomic` or `versions`; with `atomic` each row counts",
        "the lookup is refused",
    )
    listed: int = _fixed(
        100_000,
        "names listed by `frames` and `chain` in one message, and frames counted by `stats` and "
        "`authorities` after the first of them",
        "a longer list of frames is sent in pages, or refused to a client that asks for all",
    )
    error_bytes: int = _fixed(
        1 << 20,
        "bytes of the errors of failed rows in one reply",
        "further rows that fail have only their status",
    )
    client_pending_queries: int = _fixed(
        2048,
        "queries of one client received but not yet started",
        "the query is refused with `ServerBusy`",
    )
    pending_bytes: int = _fixed(
        128 << 20,
        "bytes of queries received but not yet started",
        "the query is refused with `ServerBusy`",
    )
    client_pending_bytes: int = _fixed(
        64 << 20,
        "bytes of one client's queries received but not yet started",
        "the query is refused with `ServerBusy`",
    )
    unread_reply_bytes: int = _fixed(
        64 << 20,
        "bytes of replies that wait until a client reads",
        "the client's queries are refused with `ServerBusy`",
    )
    all_unread_reply_bytes: int = _fixed(
        256 << 20,
        "bytes of replies that wait until clients read",
        "the queries of clients that have replies waiting are refused with `ServerBusy`",
    )
    waiter_links: int = _fixed(
        1_000_000,
        "frames that waiting lookups watch, counted for each lookup; a client may hold as many "
        "as are left free",
        "the lookup is refused with `ServerBusy`",
    )
    wait_s: int = _fixed(
        600, "seconds that a lookup waits for a transform", "the lookup is refused"
    )
    outcome_bytes: int = _fixed(
        64 << 20,
        "bytes of all remembered outcomes of writes; a client may hold as many as are left free",
        "the write is refused with `ServerBusy`",
    )
    default_expiry_s: int = _fixed(
        60,
        "seconds until the expiry of a write that names none",
        "the write expires: its outcome is forgotten, and it does not run any more",
    )
    refused_authorities: int = _fixed(
        1024,
        "authorities remembered that had messages refused and none accepted",
        "the one that was refused longest ago is forgotten",
    )
    put_queues_bytes: int = _fixed(
        256 << 20,
        "bytes of puts of all authorities that wait to be committed",
        "the same, with the authority that has the most waiting",
    )
    metrics_authorities: int = _fixed(
        100,
        "authorities with metrics of their own (`--metrics`)",
        "the others have none; the totals of the server count them",
    )
    change_log_bytes: int = _fixed(
        64 << 20,
        "bytes of changes that wait to be published, while a mirror listens",
        "changes are left out of the stream, and all mirrors load a new snapshot",
    )
    interest_pairs: int = _fixed(1000, "pairs of frames in one interest", "the mirror is refused")
    removed_statics: int = _fixed(
        10_000,
        "static links remembered as removed, which broadcasters do not announce again",
        "the one that was removed longest ago is forgotten",
    )
    robot_bytes: int = _fixed(
        256 << 20,
        "bytes of robots' messages (`--mirror-of`) that wait to be applied, of all together; a "
        "robot may hold as many as are left free",
        "the robot's oldest message is dropped, and asked for again, or its tree is copied again",
    )

    def check(self, name: str, value: int) -> None:
        """Raise LimitExceeded if `value` is above the limit `name`."""
        limit: int = getattr(self, name)
        if value > limit:
            raise self.exceeded(name, value)

    def check_names(self, names: int) -> None:
        """Refuse a message that has more names than the most rows can use."""
        if names > NAMES_PER_ROW * self.rows:
            raise self.exceeded("rows", names // NAMES_PER_ROW)

    def exceeded(self, name: str, value: int) -> LimitExceeded:
        """The error for a `value` above the limit `name`."""
        return LimitExceeded(
            self.describe(name, value), field=name, limit=getattr(self, name), value=value
        )

    def describe(self, name: str, value: int) -> str:
        """What is wrong with a `value` above the limit `name`, and the flag if there is one."""
        about = next(entry.metadata for entry in fields(self) if entry.name == name)
        limit = f"{getattr(self, name)}{f' (--limit {name}=N)' if about['is_set'] else ''}"
        return f"{value} {about['meaning'].partition(';')[0]}: the limit is {limit}"

    def budget(self) -> Budget:
        """What one message may cost."""
        return Budget(
            links=self.links,
            read_set=self.read_set,
            listed=self.listed,
            reply_bytes=self.reply_bytes,
            error_bytes=self.error_bytes,
        )

    def unpack(self, payload: bytes, in_steps: bool = False) -> wire.Message:
        """The map of a message; see `wire.unpack`. Raises LimitExceeded or ProtocolError."""
        return wire.unpack(payload, self.message_bytes, self.decoded_bytes, in_steps)

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


#: The limits that an operator may set, by name.
SETTABLE: Final = {entry.name: entry for entry in fields(Limits) if entry.metadata["is_set"]}


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the limits."""
    names = ", ".join(name for name in SETTABLE if name != _MEMORY)
    group = parser.add_argument_group("limits (docs/reference/limits.md)", f"NAME: {names}.")
    group.add_argument(
        "--max-memory",
        type=size(1 << 20),
        default=Limits().memory,
        metavar="BYTES",
        help="of all samples together, as in 512MB or 4G (default: 4G)",
    )
    group.add_argument(
        "--limit",
        action="append",
        type=_setting,
        default=[],
        metavar="NAME=VALUE",
        help="set a limit, as in frames=5000; repeatable",
    )


def read(options: argparse.Namespace) -> Limits:
    """The limits that the flags of `add_flags` say."""
    return Limits(memory=options.max_memory, **dict(options.limit))


def _setting(text: str) -> tuple[str, int]:
    """A type for ``NAME=VALUE``."""
    name, equals, number = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not NAME=VALUE")
    if name == _MEMORY:
        raise argparse.ArgumentTypeError(f"the limit {_MEMORY} has a flag of its own, --max-memory")
    if name not in SETTABLE:
        nearest = difflib.get_close_matches(name.replace("-", "_"), SETTABLE, 3, 0.5)
        hint = f"did you mean {' or '.join(nearest)}?" if nearest else "--help lists all"
        if name in Limits.__slots__:
            hint = f"it is fixed at {getattr(Limits(), name):,}"
        raise argparse.ArgumentTypeError(f"there is no limit {quoted(name)}: {hint}")
    highest = _HIGHEST.get(name, _HIGHEST_OF_ALL)
    # A text of more digits than any limit's value is not read as a number.
    if not re.fullmatch("[0-9]{1,20}", number, re.ASCII) or not 1 <= int(number) <= highest:
        raise argparse.ArgumentTypeError(
            f"the limit {name} is {quoted(number)}: it must be a whole number from 1 to {highest:,}"
        )
    return name, int(number)


def table() -> Iterator[str]:
    """The lines of the two tables in docs/reference/limits.md: what can be set, and what is
    fixed."""
    for is_set, head in ((True, "limit | default"), (False, "fixed | value")):
        yield f"| {head} | of what | when hit |"
        yield "|---|---|---|---|"
        for entry in fields(Limits):
            if entry.metadata["is_set"] == is_set:
                yield (
                    f"| {entry.name} | {entry.default:,} "
                    f"| {entry.metadata['meaning']} | {entry.metadata['when_hit']} |"
                )


if __name__ == "__main__":
    print("\n".join(table()))
