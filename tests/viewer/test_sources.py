"""What the viewer reads: a server's tree through a mirror, and recordings."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes.servers import ServerProcess
from tests.recordings.files import write
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.recordings import open_recording
from zenoh_tf_client import Mirror, TransformClient
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import ViewedLink

S = 10**9


@pytest.fixture
def mirror(client: TransformClient) -> Iterator[Mirror]:
    with client.mirror() as mirror:
        yield mirror


def links(source: LiveSource, time_ns: int) -> dict[str, ViewedLink]:
    found = {name: source.link(name, time_ns) for name in source.names()}
    return {name: link for name, link in found.items() if link is not None}


def test_live_links(client: TransformClient, mirror: Mirror) -> None:
    now_ns = time.time_ns()
    for i in range(11):
        stamp_ns = now_ns + i * S // 10
        client.set_transform(StampedTransform("map", "base", stamp_ns, Transform()), "wheels")
    client.set_transform(StampedTransform("base", "camera", 0, Transform()), static=True)
    mirror.wait_for()
    found = links(LiveSource(mirror), now_ns + 3 * S)
    base = found["base"]
    assert (base.parent, base.authority, base.static) == ("map", "wheels", False)
    assert base.sample_ns == now_ns + S
    assert base.age_s == pytest.approx(2.0)
    assert base.rate_hz == pytest.approx(11.0, abs=0.1)
    assert base.is_stale(1.9)
    assert not base.is_stale(2.1)
    assert found["camera"].static
    assert found["camera"].age_s is None
    assert (found["map"].parent, found["map"].age_s) == (None, None)
    # A stamp ahead of the clock is not stale.
    early = links(LiveSource(mirror), now_ns)["base"]
    assert not early.is_stale(1.0)


def test_a_paused_live_tree_shows_the_past(client: TransformClient, mirror: Mirror) -> None:
    now_ns = time.time_ns()
    for i in range(11):
        stamp_ns = now_ns + i * S // 10
        client.set_transform(StampedTransform("map", "base", stamp_ns, Transform((i, 0, 0))))
    mirror.wait_for()
    source = LiveSource(mirror)
    at_ns = now_ns + S // 2
    past = source.link("base", at_ns, past=True)
    assert past is not None
    assert past.sample_ns == at_ns
    assert (past.age_s, past.parent) == (0.0, "map")
    # No further than there are samples.
    assert source.step_ns(["base"], now_ns, -1) == now_ns
    assert source.step_ns(["base"], now_ns + S, 1) == now_ns + S
    assert source.step_ns(["base"], now_ns - 5 * S, 0) == now_ns
    assert source.step_ns(["base"], now_ns + 5 * S, 0) == now_ns + S
    assert source.step_ns(["base"], at_ns, -1) == at_ns - round(S / 11)
    assert source.step_ns(["base"], at_ns, 1) == at_ns + round(S / 11)
    client.set_transform(StampedTransform("dock", "base", now_ns + 2 * S, Transform()))
    mirror.wait_for()
    before, after = (source.link("base", now_ns + i * S, past=True) for i in (1, 2))
    assert before is not None
    assert after is not None
    assert (before.parent, after.parent) == ("map", "dock")
    assert source.step_ns(["map", "nowhere"], at_ns, 1) == at_ns


def test_removed_frames_are_gone(client: TransformClient, mirror: Mirror) -> None:
    client.set_transform(StampedTransform("map", "base", 1, Transform()))
    mirror.wait_for()
    source = LiveSource(mirror)
    assert source.link("base", 1) is not None
    client.remove_frame("base")
    mirror.wait_for()
    assert source.link("base", 1) is None


def test_a_simulators_time_goes_on_from_its_newest_stamp(
    client: TransformClient, mirror: Mirror
) -> None:
    source = LiveSource(mirror)
    client.set_transform(StampedTransform("map", "base", 5 * S, Transform()))
    mirror.wait_for()
    read = [*links(source, 0).values()]
    first_ns = source.now_ns(read)
    assert first_ns >= 5 * S
    time.sleep(0.01)
    assert source.now_ns(read) >= first_ns + S // 100
    stamped = StampedTransform("map", "base", time.time_ns(), Transform())
    client.reset()
    client.set_transform(stamped)
    mirror.wait_for()
    assert abs(source.now_ns([*links(source, 0).values()]) - time.time_ns()) < 5 * S


def test_a_server_that_is_silent_is_told(server: ServerProcess, mirror: Mirror) -> None:
    source = LiveSource(mirror)
    assert source.trouble() is None
    server.freeze()
    while (trouble := source.trouble()) is None:
        time.sleep(0.05)
    assert trouble.startswith("no heartbeat from the server for ")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RecordedSource:
    moves = [(i / 10, "/tf", [("map", "base", 1 + i / 10, float(i))]) for i in range(51)]
    late = [(9.0, "/tf", [("map", "late", 4.0, 1.0)]), (9.1, "/tf", [("world", "late", 5.0, 1.0)])]
    static = [(0.0, "/tf_static", [("base", "camera", 0.0, 1.0)])]
    path = write(tmp_path_factory.mktemp("run") / "run", [*static, *moves, *late])
    with open_recording(path) as recording:
        return RecordedSource(recording)


def test_recorded_links(recorded: RecordedSource) -> None:
    assert recorded.range_ns == (1 * S, 6 * S)
    base = recorded.link("base", 3 * S + S // 20)
    assert base is not None
    assert base.sample_ns == 3 * S + S // 20  # interpolated
    assert base.age_s == pytest.approx(0.05)
    assert base.rate_hz == pytest.approx(10.0)
    after = recorded.link("base", 8 * S)
    assert after is not None
    assert after.sample_ns == 6 * S
    assert after.age_s == pytest.approx(2.0)
    camera = recorded.link("camera", 3 * S)
    assert camera is not None
    assert (camera.static, camera.age_s, camera.parent) == (True, None, "base")


def test_a_link_before_its_first_sample_is_not_stale(recorded: RecordedSource) -> None:
    late = recorded.link("late", 2 * S)
    assert late is not None
    assert (late.sample_ns, late.parent) == (4 * S, "map")
    assert late.age_s == pytest.approx(-2.0)
    assert late.is_awaited
    assert not late.is_stale(0.0)


def test_a_recorded_link_has_the_parent_of_the_time(recorded: RecordedSource) -> None:
    before, after = recorded.link("late", 4 * S), recorded.link("late", 5 * S)
    assert before is not None
    assert after is not None
    assert (before.parent, after.parent) == ("map", "world")


def test_steps_of_a_recording_end_at_samples(recorded: RecordedSource) -> None:
    at_ns = 3 * S + S // 20
    assert recorded.step_ns(["base"], at_ns, 1) == 3 * S + S // 10
    assert recorded.step_ns(["base"], at_ns, -1) == 3 * S
    assert recorded.step_ns(["base"], 3 * S, -1) == 3 * S - S // 10
    assert recorded.step_ns(["base", "late"], 3 * S + 9 * S // 10, 1) == 4 * S
    assert recorded.step_ns(["base"], 6 * S, 1) == 6 * S  # there is none
    assert recorded.step_ns(["camera"], at_ns, 1) == at_ns


def test_when_a_recorded_frame_has_samples(tmp_path: Path) -> None:
    times = [*(i / 10 for i in range(11)), *(3 + i / 10 for i in range(11))]
    log = [(1 + t, "/tf", [("map", "base", 1 + t, 0.0)]) for t in times]
    with open_recording(write(tmp_path / "run", log)) as recording:
        source = RecordedSource(recording)
    assert source.spans_ns("base") == [(1 * S, 2 * S), (4 * S, 5 * S)]
    assert source.spans_ns("map") == []
