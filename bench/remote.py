"""The service from a client process: what a lookup costs, and what batches reach."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator

import numpy as np
import zenoh

from bench import empty_server, workload
from bench.figures import REPETITIONS, Bar, Figure
from bench.processes import free_endpoint, open_session, running
from bench.workload import ROWS, SOURCE, TARGET
from zenoh_tf import StampedTransform, Transform, keys, wire
from zenoh_tf_client import TransformClient, requests

TREE = "main"
#: Round trips of one repetition. Short turns and many of them: a round trip waits for the
#: processor four times, and so meets most of what else the machine does.
CALLS = 100
TURNS = 3 * REPETITIONS
BULK_CALLS = 40
#: A broadcaster's messages: transforms in each, messages in a repetition.
BROADCAST_ROWS = 100
BROADCAST_MESSAGES = 1000

Call = Callable[[], object]


def measure() -> Iterator[Figure]:
    """Microseconds a round trip; lookups and transforms a second."""
    endpoint = free_endpoint()
    command = ["zenoh_tf_server", "--listen", endpoint, "--tree", TREE, "--log-level", "error"]
    with running(*command), TransformClient.connect(endpoint, TREE) as tf:
        tf.set_transforms_xact([_stamped(*row) for row in workload.history()])
        yield from _round_trips(tf, endpoint)
        yield from _batches(tf)
        yield from _broadcasts(tf)


def _round_trips(tf: TransformClient, endpoint: str) -> Iterator[Figure]:
    """A lookup, and the same messages without a client around them, by turns with an empty
    query that sends and receives as many bytes."""
    request = wire.pack(requests.lookup_transform(TARGET, SOURCE).body())
    key = zenoh.KeyExpr(keys.operation(TREE, "lookup"))
    empty_endpoint = free_endpoint()
    with open_session(endpoint) as session:
        reply_bytes = _ask(session, key, request)
        with (
            running("bench.empty_server", empty_endpoint, str(reply_bytes)),
            open_session(empty_endpoint) as empty_session,
        ):
            empty_key, payload = zenoh.KeyExpr(empty_server.KEY), bytes(len(request))
            calls: list[Call] = [
                lambda: tf.lookup_transform(TARGET, SOURCE),
                lambda: _ask(session, key, request),
                lambda: _ask(empty_session, empty_key, payload),
            ]
            lookup, bare, empty = _by_turns_us(calls)
    about = f"empty query of {len(request)} and {reply_bytes} B"
    yield Figure("lookup_transform", "us", lookup, about, empty, Bar(1.3, ratio=True))
    yield Figure("its messages without the client", "us", bare, about, empty)


def _by_turns_us(calls: list[Call]) -> list[list[float]]:
    """For each call and repetition the median round trip."""
    values: list[list[float]] = [[] for _ in calls]
    for turn in range(TURNS + 1):
        for call, medians in zip(calls, values, strict=True):
            spent = []
            for _ in range(CALLS):
                start = time.perf_counter()
                call()
                spent.append(time.perf_counter() - start)
            if turn:  # the first was the warm-up
                medians.append(1e6 * statistics.median(spent))
    return values


def _batches(tf: TransformClient) -> Iterator[Figure]:
    times_ns = workload.times_ns()
    array = np.array(times_ns)
    targets, sources = [TARGET] * ROWS, [SOURCE] * ROWS
    bar = Bar(300_000, at_least=True)

    def recorded() -> None:
        with tf.batch() as batch:
            handles = [batch.lookup_transform(TARGET, SOURCE, at) for at in times_ns]
        for handle in handles:
            handle.result()

    for name, call, goal in (
        (
            f"lookup_transforms, {ROWS} rows",
            lambda: tf.lookup_transforms(TARGET, SOURCE, array),
            bar,
        ),
        (
            f"the same, {ROWS} names on either side",
            lambda: tf.lookup_transforms(targets, sources, array),
            bar,
        ),
        (f"a batch of {ROWS} lookup_transform", recorded, None),
    ):
        call()
        rates = []
        for _ in range(REPETITIONS):
            start = time.perf_counter()
            for _ in range(BULK_CALLS):
                call()
            rates.append(BULK_CALLS * ROWS / (time.perf_counter() - start))
        yield Figure(name, "/s", rates, bar=goal)


def _broadcasts(tf: TransformClient) -> Iterator[Figure]:
    """Transforms a second from the first message until the server has counted the last."""
    about = f"broadcaster, messages of {BROADCAST_ROWS}"
    transform = Transform(*workload.pose(0, 0))
    sample = 0

    def message() -> list[StampedTransform]:
        nonlocal sample
        sample += 1
        stamp_ns = workload.END_NS + sample * workload.PERIOD_NS
        return [
            StampedTransform(TARGET, f"joint{i}", stamp_ns, transform)
            for i in range(BROADCAST_ROWS)
        ]

    def built() -> Iterator[list[StampedTransform]]:
        return iter([message() for _ in range(BROADCAST_MESSAGES)])

    def building() -> Iterator[list[StampedTransform]]:
        return (message() for _ in range(BROADCAST_MESSAGES))

    with tf.broadcaster("bench") as sender:
        for name, messages, bar in (
            (about, built, Bar(300_000, at_least=True)),
            (f"{about}, with building them", building, None),
        ):
            rates = [_ingested_per_s(tf, sender.send, messages()) for _ in range(REPETITIONS + 1)]
            yield Figure(name, "/s", rates[1:], bar=bar)  # the first was the warm-up


def _ingested_per_s(
    tf: TransformClient,
    send: Callable[[list[StampedTransform]], None],
    messages: Iterator[list[StampedTransform]],
) -> float:
    expected = tf.stats()["put_transforms"] + BROADCAST_MESSAGES * BROADCAST_ROWS
    start = time.perf_counter()
    for stampeds in messages:
        send(stampeds)
    while tf.stats()["put_transforms"] < expected:
        if time.perf_counter() > start + 60:
            raise SystemExit(f"transforms were lost: {tf.stats()}")
        time.sleep(0.001)
    return BROADCAST_MESSAGES * BROADCAST_ROWS / (time.perf_counter() - start)


def _ask(session: zenoh.Session, key: zenoh.KeyExpr, payload: bytes) -> int:
    """The bytes of the reply to a query that is sent as the client sends its own."""
    for reply in session.get(
        key, payload=payload, timeout=5.0, consolidation=zenoh.ConsolidationMode.NONE
    ):
        assert reply.ok is not None
        return len(reply.ok.payload.to_bytes())
    raise SystemExit(f"no answer on {key}")


def _stamped(
    parent: str,
    child: str,
    stamp_ns: int,
    translation: workload.Vector,
    rotation: workload.Quaternion,
) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform(translation, rotation))
