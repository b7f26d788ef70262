"""Every limit of the service in one table: flags, defaults and docs/limits.md come from it.

``python -m zenoh_tf_server.limits > docs/limits.md`` writes the page.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields

from zenoh_tf.errors import LimitExceeded


def _limit(default: int, meaning: str, when_hit: str) -> int:
    value: int = field(default=default, metadata={"meaning": meaning, "when_hit": when_hit})
    return value


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of one server; each field is a flag ``--max-...`` of zenoh-tf-server."""

    frames: int = _limit(
        1 << 20,
        "frames in the tree",
        "the write that names one more is refused",
    )
    samples_per_frame: int = _limit(
        1 << 16,
        "samples kept per frame, within the cache time",
        "the oldest samples make room",
    )
    name_bytes: int = _limit(
        255,
        "UTF-8 bytes in a frame's name",
        "the request is refused",
    )
    depth: int = _limit(
        1000,
        "links that a lookup climbs from either frame",
        "the lookup fails",
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
    pending_queries: int = _limit(
        4096,
        "queries received and not yet started, per query family",
        "the query is refused",
    )
    waiters: int = _limit(
        10_000,
        "lookups waiting for a transform (`timeout_s`), counted by row",
        "the lookup is refused",
    )
    outcomes: int = _limit(
        200_000,
        "outcomes of writes remembered until the write's expiry",
        "the write is refused",
    )
    outcome_bytes: int = _limit(
        64 << 20,
        "bytes of all remembered outcomes",
        "the write is refused",
    )
    expiry_s: int = _limit(
        600,
        "seconds until a write's expiry; a write without one is remembered this long",
        "the write is refused",
    )
    connections: int = _limit(
        1000,
        "Zenoh connections to the embedded router",
        "the connection is refused",
    )

    def check(self, name: str, value: int) -> None:
        """Raise LimitExceeded if `value` is over the limit `name`."""
        limit: int = getattr(self, name)
        if value > limit:
            raise self.exceeded(name, value)

    def exceeded(self, name: str, value: int) -> LimitExceeded:
        limit: int = getattr(self, name)
        meaning = next(entry.metadata["meaning"] for entry in fields(self) if entry.name == name)
        return LimitExceeded(
            f"limit {name}: {value}, at most {limit} {meaning}",
            field=name,
            limit=limit,
            value=value,
        )

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


def _flag(name: str) -> str:
    return "--max-" + name.replace("_", "-")


def add_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("limits")
    for entry in fields(Limits):
        group.add_argument(
            _flag(entry.name),
            type=_positive,
            default=entry.default,
            metavar="N",
            help=f"{entry.metadata['meaning']} (default: %(default)s)",
        )


def from_flags(options: argparse.Namespace) -> Limits:
    return Limits(**{entry.name: getattr(options, f"max_{entry.name}") for entry in fields(Limits)})


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def page() -> Iterator[str]:
    """The lines of docs/limits.md."""
    yield "# Limits"
    yield ""
    yield "Everything that a client could make grow has a limit. Each is a flag of"
    yield "`zenoh-tf-server`; one that refuses a request answers `LimitExceeded` with the limit's"
    yield "name in `field` (with `max_` before it where the tree itself refuses), its value in"
    yield "`limit` and what hit it in `value`. Clients learn the values at connect and check the"
    yield "size of a message before they send it."
    yield ""
    yield "| limit | flag | default | of what | when hit |"
    yield "|---|---|---|---|---|"
    for entry in fields(Limits):
        yield (
            f"| {entry.name} | `{_flag(entry.name)}` | {entry.default:,} "
            f"| {entry.metadata['meaning']} | {entry.metadata['when_hit']} |"
        )
    yield ""
    yield "Tree names have at most 255 bytes, authority names as many as frame names, and a tree"
    yield "knows 4,096 authorities. A lookup that climbs deeper than `depth` links fails with"
    yield "`LookupException`, as in tf2. The embedded `TransformTree` takes the first four as"
    yield "`max_frames`, `max_samples_per_frame`, `max_name_bytes` and `max_depth`."


if __name__ == "__main__":
    print("\n".join(page()))
