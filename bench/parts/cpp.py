"""Readers in C++ beside an arm that is published: the latency of a lookup, and what many processes
cost, with the C library and with tf2. Buffers of a process receive the transforms as bare
datagrams, which cost less than ROS's messages: a lower bound in tf2's favour."""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import math
import os
import socket
import statistics
import struct
import tempfile
import time
from collections.abc import Iterator

from bench.machine import Usage, proportional_mb, resident_mb
from bench.parts import native
from bench.process import Process
from bench.report import Cell, Report, Trial, equal_poses
from bench.server import Server
from zenoh_tf import StampedTransform, Transform
from zenoh_tf import native as library
from zenoh_tf_client import TransformClient

JOINTS = 7
#: The base is published once in so many messages of the joints.
BASE_EVERY = 4
#: As bench/cpp/buffer.hpp has it.
LINK = struct.Struct("16s16sq7d")
OWN, SHARED, TF2 = "a tree of its own", "the server's memory", "tf2"
#: As the same file numbers them.
NAMES, REFERENCE, TWO_POSES, NOTHING = range(4)
CALLS = {"by names": NAMES, "by reference": REFERENCE, "two poses": TWO_POSES}
LOOKUPS, FAST_HZ = 1_000_000, 1000
READERS, ARM_HZ = 17, 200


def measure(report: Report) -> None:
    """First the latency of one reader, then the costs of many."""
    folder = native.build("bench/cpp", report.quick, f"-Dzenoh_tf_DIR={library.cmakedir()}")
    ours, theirs = (str(folder / f"{name}_reader") for name in ("zenoh_tf", "tf2"))
    programs = {OWN: ours, SHARED: ours, TF2: theirs}
    if not os.path.exists(theirs):
        print("no tf2 (Debian: libtf2-dev, libboost-thread-dev): no comparison")
        del programs[TF2]
    _latency(report, programs)
    _many(report, programs)


def _latency(report: Report, programs: dict[str, str]) -> None:
    """Of a reader that has a core for itself, beside an arm at a fast rate. All systems receive the
    same messages at the same time, and take turns in being asked."""
    with (
        _reserved_core() as core,
        tempfile.TemporaryDirectory() as folder,
        Server("--share-dir", folder) as server,
        contextlib.ExitStack() as stack,
    ):
        sockets = {system: f"{folder}/{n}" for n, system in enumerate(programs)}
        readers = {
            system: stack.enter_context(Process(program, sockets[system], *where))
            for system, program in programs.items()
            for where in [[folder] if system == SHARED else []]
        }
        del sockets[SHARED]
        paths = list(sockets.values())
        stack.enter_context(Process.of(publish, FAST_HZ, server.endpoint, paths))
        _check(readers)
        lookups = LOOKUPS // 1000 if report.quick else LOOKUPS
        trials = [("nothing", NOTHING, OWN)]
        trials += [(case, call, system) for case, call in CALLS.items() for system in readers]
        cells = [
            Cell(
                {"case": case, "system": "the clock" if call == NOTHING else system},
                functools.partial(readers[system].ask, f"latency {call} {lookups} {core}"),
            )
            for case, call, system in trials
            if (system, call) != (TF2, REFERENCE)  # it has names only
        ]
        report.measure(cells, 3)


@contextlib.contextmanager
def _reserved_core() -> Iterator[int]:
    """A core that programs which are started meanwhile leave free, if there are two."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores - {min(cores)} or cores)
    yield min(cores)
    os.sched_setaffinity(0, cores)


def _check(readers: dict[str, Process]) -> None:
    """Ends the benchmark if the answers of two systems differ."""
    for reader in readers.values():
        reader.ask(f"ask {NAMES} 0")  # waits for the first transforms
    stamp_ns = time.monotonic_ns()
    time.sleep(0.5)
    first, *others = (reader.ask(f"tool {stamp_ns}") for reader in readers.values())
    if first[-1] != stamp_ns or not all(equal_poses(first, each) for each in others):
        raise SystemExit(f"the answers differ: {first}, {others}")


def _many(report: Report, programs: dict[str, str]) -> None:
    """What processes that ask as often as the arm is published cost: with a server's memory, with
    tf2's buffer in each, and without lookups."""
    systems = {SHARED: NAMES, TF2: NAMES, "only waking up": NOTHING}
    cells = {}
    for system, call in systems.items():
        if program := programs.get(system if call == NAMES else OWN):
            run = functools.partial(_trial, report, system, program, call)
            cells[system] = Cell({"case": f"{READERS} readers", "system": system}, run)
    report.measure(list(cells.values()), 3)
    if TF2 in cells:
        values = cells[SHARED].over(cells[TF2], "percent")
        report.target(f"{READERS} readers, processor time to tf2's", values, "<=", 1)


def _trial(report: Report, system: str, program: str, call: int) -> Trial:
    # Both keep 10 s.
    warm_s, for_s = report.seconds(1 if call == NOTHING else 12), report.seconds(10)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        servers = []
        if system == SHARED:
            servers.append(stack.enter_context(Server("--share-dir", folder)))
        paths = [f"{folder}/{number}" for number in range(READERS)]
        where = [folder] if servers else []
        readers = [stack.enter_context(Process(program, path, *where)) for path in paths]
        publishers = []
        if call != NOTHING:
            run = (publish, ARM_HZ, servers[0].endpoint if servers else "")
            fed = [] if servers else paths
            publishers.append(stack.enter_context(Process.of(*run, fed)))
        for reader in readers:
            reader.send(f"ask {call} {warm_s + for_s + 1}")
        time.sleep(warm_s)
        with Usage(*(each.pid for each in (*readers, *servers, *publishers))) as usage:
            time.sleep(for_s)
        pss_mb = [proportional_mb(each.pid) for each in (*readers, *servers)]
        rss_mb = statistics.median(resident_mb(reader.pid) for reader in readers)
        answers = [json.loads(reader.read_line()) for reader in readers]
    percent = [100 * spent_s / usage.took_s for spent_s in usage.cpu_s]
    found = {
        "percent": sum(percent),
        "readers_percent": sum(percent[:READERS]),
        "others_percent": sum(percent[READERS:]),
        "mb": sum(pss_mb),
        "reader_mb": statistics.median(pss_mb[:READERS]),
        "reader_resident_mb": rss_mb,
        "unanswered": sum(answer["unanswered"] for answer in answers),
    }
    if servers:
        found["server_percent"], found["server_mb"] = percent[READERS], pss_mb[READERS]
    if publishers:
        found["publisher_percent"] = percent[-1]
        found["age_ms_p50"] = statistics.median(answer["age_ms_p50"] for answer in answers)
    return found


def publish(rate_hz: float, endpoint: str, paths: list[str]) -> None:
    """Publishes an arm's joints at a rate, and its base more slowly, to a server and to sockets."""
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as datagrams,
        TransformClient.connect(endpoint) if endpoint else contextlib.nullcontext() as tf,
    ):
        send = [tf.broadcaster(name).send for name in ("base", "arm")] if tf else []
        print("ready", flush=True)
        due_s = time.monotonic()
        for tick in itertools.count():
            messages = {1: joints()} if tick % BASE_EVERY else {0: base(), 1: joints()}
            for number, links in messages.items():
                if send:
                    send[number](links)
                bytes_ = b"".join(map(packed, links)) if paths else b""
                for path in paths:
                    datagrams.sendto(bytes_, path)
            # A publisher that cannot keep up sends no burst afterwards.
            due_s = max(due_s + 1 / rate_hz, time.monotonic() - 1)
            time.sleep(max(0.0, due_s - time.monotonic()))


def base() -> list[StampedTransform]:
    stamp_ns = time.monotonic_ns()
    pose = Transform((math.sin(1e-9 * stamp_ns), 2, 0))
    return [StampedTransform("map", "link0", stamp_ns, pose)]


def joints() -> list[StampedTransform]:
    stamp_ns = time.monotonic_ns()
    return [_joint(number, stamp_ns) for number in range(1, JOINTS + 1)]


def _joint(number: int, stamp_ns: int) -> StampedTransform:
    """Turns to and fro in some seconds, about an axis that is not its neighbours'."""
    half = 0.5 * math.sin(1e-9 * stamp_ns + number)
    sine, cosine = math.sin(half), math.cos(half)
    rotation = (0, sine, 0, cosine) if number % 2 else (0, 0, sine, cosine)
    pose = Transform((0.1, 0, 0.3), rotation)
    return StampedTransform(f"link{number - 1}", f"link{number}", stamp_ns, pose)


def packed(link: StampedTransform) -> bytes:
    names = link.parent_frame.encode(), link.child_frame.encode()
    return LINK.pack(*names, link.stamp_ns, *link.transform.pose())
