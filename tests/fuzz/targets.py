"""What is fuzzed without a network: decoder, request handler, keys and configuration.

Each target accepts any bytes, and raises AssertionError if what came of them is wrong.
"""

from __future__ import annotations

import argparse
import asyncio
import atexit
import contextlib
import functools
import logging
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeReplay, Changes, Frames
from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException, TransformException
from zenoh_tf_server import config_file, flags
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.requests.service import Service
from zenoh_tf_server.requests.surroundings import Surroundings
from zenoh_tf_server.streams.interests import Interests
from zenoh_tf_server.streams.snapshots import Snapshots
from zenoh_tf_server.streams.stream import Stream

#: Small, so that no input takes long and every limit is hit.
LIMITS = Limits(frames=300, samples_per_frame=64, rows=1000, waiters=64, outcomes=256)
_TYPES = keys.REQUEST_TYPES
#: A reply may be this much longer than its request; a list of all frames is the longest.
_LONGEST_REPLY = 1 << 20
_SLOW_S = 5.0


def decoder(data: bytes) -> None:
    """Everything that parses a message raises nothing but the project's errors."""
    for read in (Changes, Frames):
        with contextlib.suppress(TransformException):
            read(data)
    try:
        message = wire.unpack(data)
    except TransformException:
        return
    for parse in (
        wire.parse_one_read,
        wire.parse_lookup,
        wire.parse_commit,
        wire.parse_write,
        wire.parse_batch,
        lambda body: wire.parse_lookup_reply(body, 2),
        lambda body: list(wire.parse_lookup_reply(body, 1).rows()),
        lambda body: list(wire.parse_read_set(body)),
        lambda body: wire.parse_batch_reply(body, 2),
        lambda body: wire.parse_commit_reply(body, 2),
        lambda body: wire.parse_value(body, str),
        wire.parse_one_answer,
        lambda body: _apply(wire.parse_stream(body).changes),
        lambda body: _apply(wire.parse_snapshot_plan(body).changes),
        wire.parse_snapshot_request,
        lambda body: ChangeReplay(_small_tree()).load(wire.parse_snapshot_piece(body).frames),
        wire.parse_missed_request,
        wire.parse_interest,
        wire.parse_missed_reply,
    ):
        try:
            parse(message)
        except TransformException as error:
            assert str(error) is not None


def _small_tree() -> TransformTree:
    return TransformTree(max_frames=16)


def _apply(changes: bytes | None) -> None:
    if changes is not None:
        ChangeReplay(_small_tree()).apply(1, changes)


class _InternalErrors(logging.Handler):
    """Keeps what the server logs as its own fault."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(self.format(record))


class _Reply:
    """A ReplyCallback that checks that it is called once, with a message."""

    client = "fuzz"

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, reply: bytes, failed: bool) -> None:
        self.calls += 1
        assert self.calls == 1, "two replies to one request"
        assert len(reply) < _LONGEST_REPLY, f"a reply of {len(reply)} bytes"
        message = wire.unpack(reply)
        assert ("error" in message) == failed
        if failed:
            assert isinstance(wire.decode_error(message["error"]), TransformException)


@functools.cache
def _service() -> tuple[Service, _InternalErrors]:
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="fuzz loop", daemon=True).start()
    errors = _InternalErrors()
    log = logging.getLogger("zenoh_tf")
    log.addHandler(errors)
    log.propagate = False
    tree = TransformTree(
        10.0,
        max_frames=LIMITS.frames,
        max_samples_per_frame=LIMITS.samples_per_frame,
        max_name_bytes=LIMITS.name_bytes,
        max_depth=LIMITS.depth,
        max_log_bytes=LIMITS.change_log_bytes,
    )
    instance = "0123456789abcdef"
    stream = Stream(tree, instance, LIMITS)
    interests = Interests(tree, stream, instance, LIMITS)
    settings = wire.TreeSettings(10**10, LIMITS.frames, LIMITS.samples_per_frame, 255, LIMITS.depth)
    snapshots = Snapshots(tree, stream, interests, instance, settings)
    around = Surroundings(reads={"snapshot": snapshots.snapshot, "missed": snapshots.missed})
    service = Service(tree, "main", instance, LIMITS, loop, around=around)
    atexit.register(service.close)
    return service, errors


def handler(data: bytes) -> None:
    """A request gets one reply, soon, and is never the server's own fault. The first byte says of
    which type of request it is."""
    service, errors = _service()
    request_type = _TYPES[data[0] % len(_TYPES)] if data else "info"
    reply = _Reply()
    start_s = time.thread_time()  # other programs do not count
    service.handle(request_type, data[1:], reply)
    took_s = time.thread_time() - start_s
    assert took_s < _SLOW_S, f"{took_s:.1f} s for {len(data)} bytes"
    assert not errors.messages, errors.messages[0]


def key(data: bytes) -> None:
    """A chunk of a key is either refused or the one spelling of its name."""
    text = data.decode("utf-8", "surrogateescape")
    try:
        name = keys.unescape(text)
    except InvalidArgumentException:
        pass
    else:
        assert keys.escape(name) == text
    try:
        chunk = keys.escape(text)
    except InvalidArgumentException:
        return
    assert keys.unescape(chunk) == text
    assert keys.last_name(keys.put("main", text, static=False)) == text


@functools.cache
def _flags() -> tuple[argparse.ArgumentParser, Path]:
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return flags.parser(), Path(folder.name, "config.toml")


def config(data: bytes) -> None:
    """A configuration file is read, or refused with one line that names what is wrong."""
    parser, path = _flags()
    path.write_bytes(data)
    try:
        config_file.read(parser, path)
    except InvalidArgumentException as error:
        assert str(error)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "decoder": decoder,
    "handler": handler,
    "key": key,
    "config": config,
}
