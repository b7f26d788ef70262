"""The demo: a server, four sensors and remote clients on this machine, in under 20 seconds.

    python examples/demo.py

Each sensor and each client is a process of its own. All figures are measured while it runs.
"""

from __future__ import annotations

import time
from typing import Any

from demo_robot import motion, page
from demo_robot.clients import error_mm
from demo_robot.processes import Child, ChildFailed, Children, run_demo
from demo_robot.sensors import SENSORS
from zenoh_tf import FrameInfo, Transform
from zenoh_tf_client import TransformClient


def _run(children: Children) -> None:
    server, endpoint, client = children.start_server()
    with client as tf:
        sensors = {
            name: children.start("demo_robot.sensors", name, "--connect", endpoint)
            for name in SENSORS
        }

        def ask(role: str, seconds: float) -> Child:
            return children.start(
                "demo_robot.clients", role, "--connect", endpoint, "--seconds", str(seconds)
            )

        print()
        page.heading("A robot, its sensors, and the tree that they share")
        page.prose(
            f"""zenoh-tf-server listens on {endpoint}. Four sensors publish to it, each a
            process of its own: localisation (map → odom, 10 Hz), wheels (odom → base_link,
            50 Hz), the arm's three joints (base_link → ... → wrist, 200 Hz), and a camera that
            sees an object (camera → object, 15 Hz)."""
        )
        _wait_for_history(tf, [server, *sensors.values()])
        _lookup_at_a_time(tf)
        _staleness(ask("staleness", 3.0).report())
        # The gripper closes around the object, so the camera no longer sees it.
        sensors["camera"].terminate()
        sensors["camera"].report()
        mover, reader = ask("mover", 30.0), ask("reader", 3.0)
        seen = reader.report()
        mover.terminate()  # not before: the reader may have taken long to start
        _together(mover.report(), seen)
        methods = ask("methods", 3.0).report()
        del sensors["camera"]
        for sensor in sensors.values():
            sensor.terminate()
        sent = {name: sensor.report() for name, sensor in sensors.items()}
        _methods(methods)
        _rates(sent, {name: tf.frame(SENSORS[name].child_frame) for name in sensors})


def _wait_for_history(tf: TransformClient, children: list[Child]) -> None:
    """Wait until every sensor has published for a second."""
    give_up = time.monotonic() + 30.0

    def wait(stamp_ns: int | None) -> None:
        while not all(tf.can_transform("map", frame, stamp_ns) for frame in ("wrist", "object")):
            for child in children:
                child.check()
            if time.monotonic() > give_up:
                raise ChildFailed("the sensors' data did not arrive within 30 s")
            time.sleep(0.05)

    wait(None)
    wait(time.time_ns() + 1_000_000_000)


def _lookup_at_a_time(tf: TransformClient) -> None:
    then_ns = time.time_ns() - 500_000_000
    wrist = tf.lookup_transform("map", "wrist", then_ns, timeout_s=2.0)
    now = tf.lookup_latest_transform_xact("map", "object")
    seen_ns = tf.lookup_latest_transform_xact("camera", "object").stamp_ns
    # Waits until the slower sensors have published data after that time.
    seen = tf.lookup_transform("map", "object", seen_ns, timeout_s=2.0)

    page.heading("A lookup at a time")
    page.prose(
        """Between two measurements the tree interpolates every link, to the time that you ask
        for. The demo knows how the robot truly moves, so it can say how far off an answer is."""
    )
    page.table(
        [
            ("where", "when", "answer: x, y, z in metres", "off by"),
            _answer("wrist in map", "500 ms ago", wrist.transform, motion.X_map_wrist(then_ns)),
            _answer("object in map", "as the camera saw it", seen.transform, motion.X_map_object),
            _answer("object in map", "latest", now.transform, motion.X_map_object),
        ]
    )
    page.prose(
        """The object lies still while the camera moves. What the camera saw is right at the time
        of its picture; combined with the newest pose of the robot it is wrong."""
    )


def _answer(where: str, when: str, answer: Transform, truth: Transform) -> tuple[str, ...]:
    x, y, z = answer.translation.tolist()
    return where, when, f"{x:7.3f} {y:7.3f} {z:7.3f}", f"{error_mm(answer, truth):.2f} mm"


def _staleness(seen: dict[str, Any]) -> None:
    page.heading("Latest, and latest common")
    page.prose(
        f"""Where is the wrist in map *now*? tf2's "latest" is the newest time that every link can
        serve, so the slowest sensor holds all others back. Here "latest" takes every link's
        newest measurement. Medians of {seen["answers"]:,} answers each, to a remote client:"""
    )
    common, latest = seen["age_ms"]["common"], seen["age_ms"]["latest"]
    rows = [("age of the data used", "latest common", "latest")]
    rows += [
        (f"{parent} → {child}", f"{common[i]:.1f} ms", f"{latest[i]:.1f} ms")
        for i, (parent, child) in enumerate(seen["links"])
    ]
    mean, error = seen["mean_age_ms"], seen["error_mm"]
    rows.append(("mean over the links", f"{mean['common']:.1f} ms", f"{mean['latest']:.1f} ms"))
    rows.append(
        ("wrist off by", f"{error['common']:.1f} mm", f"{error['latest']:.1f} mm"),
    )
    page.table(rows)


def _together(moved: dict[str, Any], seen: dict[str, Any]) -> None:
    page.heading("Gripper and object move together")
    torn, reads = seen["torn"], seen["reads"]
    page.prose(
        f"""A client grasps the object (its parent is now the wrist, not the camera) and lifts
        gripper and object, {moved["moves"]:,} times in {moved["spent_s"]:.1f} s, each time both
        links in one transaction. Another client reads the pair over and over. A read that sees
        only one of them moved is torn."""
    )
    page.table(
        [
            ("how it reads", "pairs read", "torn"),
            ("two lookups, one after the other", f"{reads['separate']:,}", f"{torn['separate']:,}"),
            ("one transactional lookup", f"{reads['transaction']:,}", f"{torn['transaction']:,}"),
        ]
    )
    if len(seen["lifts_seen"]) < 2:
        raise ChildFailed("the reader saw no movement, so its figures prove nothing")
    if torn["transaction"]:
        raise ChildFailed("a transactional read was torn")
    page.prose(page.good("The transactional reader never saw only one of them moved."))


def _methods(seen: dict[str, Any]) -> None:
    page.heading("Three methods to read")
    page.prose(
        """The same lookup of the wrist in map, over five links, again and again: by a query of the
        server; in the server's memory, which clients on its host read by themselves; and in a
        mirror, a copy of the tree in the client, on any host."""
    )
    names = {"query": "a query", "shared": "the server's memory", "mirror": "a mirror"}
    rows = [("how it reads", "median", "lookups/s", "processor each", "state at most")]
    rows += [
        (
            names[method],
            f"{found['p50_us']:,.1f} us",
            f"{found['per_s']:,.0f}",
            f"{found['cpu_us']:,.1f} us",
            f"{seen['mirror_age_ms']:.1f} ms old" if method == "mirror" else "the server's own",
        )
        for method, found in seen["methods"].items()
    ]
    page.table(rows)
    page.prose(
        f"""In batches of {seen["batch"]:,} by query, interpolated at {seen["batch"]:,} times, it
        gets {seen["batched_per_s"]:,.0f} lookups per second."""
    )


def _rates(sent: dict[str, dict[str, Any]], stored: dict[str, FrameInfo]) -> None:
    page.heading("Rates, with all of this on one machine")
    rows = [("sensor", "asked for", "sent", "stored by the server")]
    rows += [
        (
            name,
            f"{report['asked_hz']:.0f} Hz",
            f"{report['reached_hz']:.1f} Hz",
            f"{_stored_hz(stored[name]):.1f} Hz",
        )
        for name, report in sent.items()
    ]
    page.table(rows)


def _stored_hz(link: FrameInfo) -> float:
    """Return the mean rate of the samples that the server keeps."""
    if link.oldest_stamp_ns is None or link.newest_stamp_ns is None:
        return 0.0
    return (link.samples - 1) * 1e9 / max(1, link.newest_stamp_ns - link.oldest_stamp_ns)


if __name__ == "__main__":
    raise SystemExit(run_demo(_run))
