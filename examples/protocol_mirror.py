"""A mirror that is written from docs/reference/protocol.md alone: it follows a server's stream.

    python examples/protocol_mirror.py --connect tcp/127.0.0.1:7447

It keeps a copy of all frames and their histories, and prints what moves.
"""

from __future__ import annotations

import bisect
import time
from dataclasses import dataclass, field
from itertools import pairwise
from queue import SimpleQueue
from typing import Any

import msgpack
import zenoh

from protocol_client import Body, Client, TfError, connect, poses, values

NO_PARENT = (1 << 32) - 1
SAMPLE, STATIC, CREATED, CLEARED, REMOVED, NEW_VERSION, ORPHANED = range(7)
SERVER_RESTARTED = 15

Sample = tuple[str | None, tuple[float, ...]]  # parent, X_parent_child


@dataclass
class Frame:
    version: int
    authority: str = ""
    static: bool = False
    stamps: list[int] = field(default_factory=list)  # ascending
    samples: dict[int, Sample] = field(default_factory=dict)  # by stamp; one if it is static

    def clear(self) -> None:
        self.authority, self.static, self.stamps, self.samples = "", False, [], {}

    def store(self, stamp_ns: int, sample: Sample, cache_ns: int, most: int) -> None:
        if self.static:
            self.clear()
        if stamp_ns not in self.samples:
            bisect.insort(self.stamps, stamp_ns)
        self.samples[stamp_ns] = sample
        oldest_ns = self.stamps[-1] - cache_ns
        while self.stamps[0] < oldest_ns or len(self.stamps) > most:
            del self.samples[self.stamps.pop(0)]


class Mirror:
    """Not for several threads: `follow` applies what has come."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.frames: dict[str, Frame] = {}
        self.instance, self.last, self.loads = "", 0, 0
        self._messages: SimpleQueue[zenoh.Sample] = SimpleQueue()
        key = f"{client.prefix}/stream/*"
        self._subscriber = client.session.declare_subscriber(key, self._messages.put)
        self.load()

    def load(self) -> None:
        """A new copy. It may be read once the stream has reached the highest `last`."""
        plan = self.client.ask("snapshot", {})
        self.settings, self.instance, self.last = plan["settings"], plan["instance"], plan["seq"]
        self.frames, reach = {}, self.last
        bounds = values("I", plan["bounds"])
        for number, (begin, until) in enumerate(pairwise(bounds)):
            reached = begin
            while reached < until:
                body = {
                    "instance": self.instance,
                    "piece": number,
                    "after": reached,
                    "until": until,
                }
                piece = self.client.ask("snapshot", body)
                self._add(msgpack.unpackb(piece["frames"]))
                reached, reach = piece["reached"], max(reach, piece["last"])
        self.loads += 1
        self.follow(reach)

    def _add(self, piece: Body) -> None:
        names, authorities = piece["names"], piece["authorities"]
        samples = zip(
            values("q", piece["stamp"]), values("I", piece["parent"]), poses(piece["pose"]),
            strict=True,
        )  # fmt: skip
        frames = (values(kind, piece[name]) for name, kind in (
            ("frame", "I"), ("version", "Q"), ("static", "B"), ("authority", "I"), ("count", "I"),
        ))  # fmt: skip
        for name, version, static, authority, count in zip(*frames, strict=True):
            frame = Frame(version, authorities[authority], bool(static))
            for _ in range(count):
                stamp_ns, parent, pose = next(samples)
                frame.stamps.append(stamp_ns)
                frame.samples[stamp_ns] = (None if parent == NO_PARENT else names[parent], pose)
            self.frames[names[name]] = frame

    def follow(self, until: int, timeout_s: float = 10.0) -> list[str]:
        """Apply messages until the copy has a commit, or is of another server. Returns the frames
        that have changed."""
        changed: list[str] = []
        deadline_s = time.monotonic() + timeout_s
        while self.last < until:
            sample = self._messages.get(timeout=max(deadline_s - time.monotonic(), 0.001))
            message = msgpack.unpackb(sample.payload.to_bytes())
            if str(sample.key_expr) != f"{self.client.prefix}/stream/{message['instance']}":
                continue
            if message["instance"] != self.instance:  # another server has taken over, or is gone
                if self.client.hello()["instance"] == self.instance:
                    continue
                self.load()
                return list(self.frames)
            if message["first"] > self.last + 1 and not self._fetch(changed):
                self.load()
            self._apply(message, changed)
        return changed

    def _fetch(self, changed: list[str]) -> bool:
        """Get the messages that were missed. False: the server has them no more."""
        body = {"instance": self.instance, "first": self.last + 1}
        try:
            messages = self.client.ask("missed", body)["messages"]
        except TfError as error:
            if error.code != SERVER_RESTARTED:
                raise
            return False
        for data in messages:
            self._apply(msgpack.unpackb(data), changed)
        return bool(messages)

    def _apply(self, message: Body, changed: list[str]) -> None:
        if message["last"] <= self.last or message["first"] > self.last + 1:
            return  # known already, or there is a gap still: the next message shows it again
        self.last = message["last"]
        if "changes" not in message:
            return
        changes = msgpack.unpackb(message["changes"])
        names, authorities = changes["names"], changes["authorities"]
        samples = zip(
            values("I", changes["parent"]), values("I", changes["authority"]),
            values("q", changes["stamp"]), poses(changes["pose"]), strict=True,
        )  # fmt: skip
        lost = iter(values("I", changes["lost"]))
        # All changes of a commit give a frame one version: compare with that before the message.
        before = {name: self.frames[name].version for name in names if name in self.frames}
        columns = changes["kind"], values("I", changes["frame"]), values("Q", changes["version"])
        for kind, index, version in zip(*columns, strict=True):
            row: Any = next(samples) if kind <= STATIC else next(lost) if kind == ORPHANED else None
            if version > before.get(names[index], 0):
                changed.append(names[index])
                self._change(kind, names, names[index], version, row, authorities)

    def _change(
        self, kind: int, names: list[str], name: str, version: int, row: Any, authorities: list[str]
    ) -> None:
        if kind == REMOVED:
            self.frames.pop(name, None)
            return
        frame = self.frames.setdefault(name, Frame(version))
        frame.version = version
        if kind in (CLEARED, STATIC):
            frame.clear()
        if kind <= STATIC:
            parent, authority, stamp_ns, pose = row
            limits = self.settings["cache_ns"], self.settings["max_samples_per_frame"]
            frame.store(stamp_ns, (names[parent], pose), *limits)
            frame.authority, frame.static = authorities[authority], kind == STATIC
        elif kind == ORPHANED and row != NO_PARENT:
            for stamp_ns, (parent, pose) in frame.samples.items():
                if parent == names[row]:
                    frame.samples[stamp_ns] = (None, pose)


def main() -> None:
    mirror = Mirror(connect())
    print(f"{len(mirror.frames)} frames", *sorted(mirror.frames))
    while True:
        for name in dict.fromkeys(mirror.follow(mirror.last + 1, timeout_s=1e6)):
            frame = mirror.frames.get(name)
            print(name, "is gone" if frame is None else f"has {len(frame.samples)} samples")


if __name__ == "__main__":
    main()
