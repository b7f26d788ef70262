"""``zenoh-tf replay`` with recordings made by the tests, against a real server."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.recordings.files import Log, write
from tests.support.command_line import Run, begun, run_without
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.recordings.ingest import Feed

from .conftest import document, refusal, succeeds


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_everything_is_there_when_it_ends(run: Run, tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / ("log.bag" if kind == "bag" else "log"), kind=kind)
    summary = document(run("replay", str(path), "--json"))
    assert summary["transforms"] == 53
    assert summary["messages"] == 53
    assert summary["topics"] == ["/robot2/tf", "/tf", "/tf_static"]

    ask = ("--json", "lookup", "odom", "camera")
    answer = document(run(*ask, "--at", "7.51s"))
    assert answer["translation"] == pytest.approx([26.5, 0.0, 0.0])
    answer = document(run(*ask))
    assert answer["stamp_ns"] == 8_000_000_000


def test_real_speed_and_multiples_of_it(run: Run, tmp_path: Path) -> None:
    """The recording lasts 1.1 s."""
    path = write(tmp_path / "log")
    took = {}
    for rate in ("1", "1000"):
        took[rate] = document(run("--json", "replay", str(path), "--rate", rate))["seconds"]
    assert took["1"] >= 1.1


def test_a_part_of_it(run: Run, tmp_path: Path) -> None:
    """Static links from before the part are there."""
    path = str(write(tmp_path / "log"))
    summary = document(run("--json", "replay", path, "--start", "+0.5s", "--end", "-0.3s"))
    assert summary["transforms"] == 12
    assert summary["topics"] == ["/tf", "/tf_static"]
    answer = document(run("--json", "frame", "base"))
    assert (answer["oldest_stamp_ns"], answer["newest_stamp_ns"]) == (
        7_500_000_000,
        7_700_000_000,
    )
    assert run("lookup", "odom", "camera").returncode == 0


def test_the_part_is_chosen_by_stamps(run: Run, tmp_path: Path) -> None:
    """The log's clock is another one, a message is late, and a static link comes after the part."""
    log: Log = [
        *[(100.0 + i, "/tf", [("a", "b", 50.0 + i, float(i))]) for i in range(3)],
        (103.0, "/tf", [("a", "b", 53.0, 3.0), ("a", "c", 51.5, 9.0)]),
        (200.0, "/tf_static", [("b", "camera", 0.0, 1.0)]),
    ]
    path = str(write(tmp_path / "log", log))
    # At twice real speed it would take 50 s if it waited for the static link.
    done = run("--json", "replay", path, "--start", "+1s", "--end", "52s", "--rate", "2")
    assert json.loads(done.stdout)["transforms"] == 4
    answer = document(run("--json", "frame", "b"))
    assert (answer["oldest_stamp_ns"], answer["newest_stamp_ns"]) == (51 * 10**9, 52 * 10**9)
    assert document(run("--json", "frame", "c"))["newest_stamp_ns"] == 51_500_000_000
    assert run("lookup", "a", "camera").returncode == 0


def test_parts_that_cannot_be_meant(zenoh_tf: Run, tmp_path: Path) -> None:
    """Those are found without a server."""
    path = str(write(tmp_path / "log"))
    line = refusal(zenoh_tf("replay", path, "--start", "0.5s"))
    assert "--start 0.5s is the stamp 0.500000000 s, but the recording is from 7.0" in line
    line = refusal(zenoh_tf("replay", path, "--start", "+0.5s", "--end", "+0.4s"))
    assert "--end (7.400000000 s) is before 7.500000000 s" in line


def test_as_if_it_happened_now(run: Run, tmp_path: Path) -> None:
    path = str(write(tmp_path / "log"))
    before_ns = time.time_ns()
    assert run("replay", path, "--clock", "now", "--rate", "4").returncode == 0
    frame = document(run("--json", "frame", "base"))
    assert before_ns < frame["oldest_stamp_ns"]
    # A second at four times real speed.
    assert frame["newest_stamp_ns"] - frame["oldest_stamp_ns"] == 250_000_000


def test_again_and_again(server: Any, client: TransformClient, tmp_path: Path) -> None:
    """The stamps continue after the last turn's: the tree would accept no older ones."""
    path = str(write(tmp_path / "log"))
    options = ("--connect", server.endpoint, "replay", path, "--loop", "--rate", "10")
    with begun(*options) as process:
        while not client.can_transform("odom", "camera", 10_500_000_000):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (out, err) == ("", "interrupted\n")
    # The turns begin at 7, 8.01, 9.02 and 10.03 s.
    for begin_ns in (7_000_000_000, 8_010_000_000, 9_020_000_000, 10_030_000_000):
        for age_ns, x in ((0, 1.0), (400_000_000, 21.0)):
            found = client.lookup_transform("odom", "camera", begin_ns + age_ns)
            assert found.transform.translation[0] == pytest.approx(x)


def test_log_order_decides_between_static_and_moving(run: Run, tmp_path: Path) -> None:
    """Static and dynamic links have different keys, which the server ingests in parallel."""
    log: Log = [
        (float(i), "/tf_static" if i % 2 else "/tf", [("a", "b", 1.0 + i, float(i))])
        for i in range(20)
    ]
    path = write(tmp_path / "log", log)
    assert run("replay", str(path)).returncode == 0
    answer = document(run("--json", "latest", "a", "b"))
    assert answer["translation"][0] == 19.0


def test_a_link_that_turns_around(run: Run, tmp_path: Path) -> None:
    """First a is the parent of b, then b of a: a cycle only if committed at one instant."""
    log: Log = [
        (1.0, "/tf", [("world", "a", 1.0, 1.0), ("a", "b", 1.0, 1.0)]),
        (2.0, "/tf", [("world", "b", 2.0, 3.0)]),
        (2.0, "/tf", [("b", "a", 2.0, 1.0)]),
    ]
    path = write(tmp_path / "log", log)
    succeeds(run("replay", str(path)))
    ask = ("--json", "latest", "world", "a")
    assert document(run(*ask))["translation"][0] == 4.0


def test_rows_that_are_no_transforms_are_skipped(run: Run, tmp_path: Path) -> None:
    log: Log = [
        (1.0, "/tf", [("a", "b", 1.0, 1.0), ("a", "a", 1.0, 1.0), ("a", "c", 1.0, float("nan"))])
    ]
    path = write(tmp_path / "log", log)
    done = run("replay", str(path))
    assert (done.returncode, done.stderr) == (
        0,
        "zenoh-tf: 2 transforms skipped, which are not valid, such as: cannot set the transform of "
        "child 'a' in parent 'a': a frame cannot be its own parent\n",
    )
    assert "1 transforms" in done.stdout


def test_what_the_cache_does_not_keep_is_reported(run: Run, tmp_path: Path) -> None:
    log: Log = [(1.0, "/tf", [("a", "b", 1000.0, 1.0)]), (2.0, "/tf", [("a", "b", 1.0, 1.0)])]
    path = write(tmp_path / "log", log)
    assert "1 of them dropped on arrival" in succeeds(run("replay", str(path), "--rate", "10"))


def test_other_publishers_do_not_end_it_early(client: TransformClient) -> None:
    """Transforms of other authorities do not count as those of the replay."""
    feed = Feed(client, "replay", patience_s=10)
    others = client.broadcaster("others")
    for stamp_ns in range(300):
        others.send(StampedTransform("other", "busy", stamp_ns, Transform()))
    count = 50_000
    feed.add((StampedTransform("a", "b", i, Transform()) for i in range(count)), static=False)
    feed.finish()
    assert client.frame("b").newest_stamp_ns == count - 1
    assert feed.transforms == count


def test_progress_bar_on_a_terminal(
    server: Any, tmp_path: Path, in_terminal: Callable[..., str]
) -> None:
    path = write(tmp_path / "log")
    output = in_terminal("--connect", server.endpoint, "replay", str(path))
    assert "100 %" in output
    assert "█" in output
    assert output.splitlines()[-1].endswith("(/robot2/tf, /tf, /tf_static)")


def test_interrupted(server: Any, run: Run, tmp_path: Path) -> None:
    path = write(
        tmp_path / "log", [(float(i), "/tf", [("a", "b", 1.0 + i, 1.0)]) for i in range(90)]
    )
    with begun("--connect", server.endpoint, "replay", str(path), "--rate", "1") as process:
        ask = ("lookup", "a", "b")
        while run(*ask).returncode != 0:
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (out, err) == ("", "interrupted\n")
    assert process.returncode == -signal.SIGINT


def test_bad_files(zenoh_tf: Run, tmp_path: Path) -> None:
    """Bad files are reported without a connection to a server."""
    text = tmp_path / "notes.txt"
    text.write_text("no recording")
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(write(tmp_path / "log").read_bytes()[:200])
    for path in (tmp_path / "nothing.mcap", text, broken, tmp_path):
        line = refusal(zenoh_tf("replay", str(path)))
        assert str(path) in line
    line = refusal(zenoh_tf("replay", str(write(tmp_path / "good")), "--topic", "/robot9/tf"))
    assert "none of the chosen topics has transforms" in line


def test_a_recording_without_transforms(zenoh_tf: Run, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    folder = tmp_path / "log"
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"]("hello")
        writer.write(topic, 1, store.serialize_cdr(text, "std_msgs/msg/String"))
    line = refusal(zenoh_tf("replay", str(folder)))
    assert "no message of type tf2_msgs/msg/TFMessage" in line


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_an_empty_recording(zenoh_tf: Run, tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "log"
    storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(folder, version=9, storage_plugin=storage):
        pass
    assert "the recording is empty" in refusal(zenoh_tf("replay", str(folder)))


@pytest.mark.parametrize("rate", ["1e-300", "1e-15"])
def test_a_message_that_would_never_come(run: Run, tmp_path: Path, rate: str) -> None:
    line = refusal(run("replay", str(write(tmp_path / "log")), "--rate", rate))
    assert f"at --rate {rate} the next message" in line


@pytest.mark.parametrize(("library", "kind"), [("mcap", "mcap"), ("rosbags", "bag")])
def test_without_the_extra(tmp_path: Path, library: str, kind: str) -> None:
    path = write(tmp_path / f"log.{kind}", kind=kind)
    line = refusal(run_without(library, "replay", str(path)))
    assert "pip install 'zenoh-tf[recordings]'" in line


def test_a_server_that_refuses(start_server: Any, zenoh_tf: Run, tmp_path: Path) -> None:
    server = start_server("--one-authority-per-frame")
    with server.connect() as tf:
        tf.set_transform(StampedTransform("odom", "base", 1, Transform()), authority="wheels")
    path = write(tmp_path / "log")
    done = zenoh_tf("--connect", server.endpoint, "replay", str(path))
    line = refusal(done)
    assert "the server refused 51 of the 53 transforms sent as 'replay'" in line
    assert "InvalidArgumentException" in line
    assert "published by 'wheels'" in line


def test_refusals_of_others_do_not_fail_it(client: TransformClient) -> None:
    """Each authority answers for its own transforms only."""
    feed = Feed(client, "replay", patience_s=10)
    with client.broadcaster("broken") as broken:
        broken.send(StampedTransform("x", "x", 1, Transform()))
        wait_until(lambda: client.stats()["bad_puts"])
    feed.add((StampedTransform("a", "b", i, Transform()) for i in range(1200)), static=False)
    feed.finish()
    assert client.frame("b").newest_stamp_ns == 1199
    assert (feed.transforms, feed.dropped_as_too_old, feed.no_longer_kept()) == (1200, 0, 0)


def test_refusals_from_before_do_not_fail_it(client: TransformClient) -> None:
    before = client.stats()["bad_puts"]
    with client.broadcaster("replay") as earlier:
        earlier.send(StampedTransform("x", "x", 1, Transform()))
        wait_until(lambda: client.stats()["bad_puts"] > before)
    feed = Feed(client, "replay", patience_s=10)
    feed.add([StampedTransform("a", "b", 1, Transform())], static=False)
    feed.finish()


def test_what_has_left_the_cache_is_reported(
    start_server: Any, zenoh_tf: Run, tmp_path: Path
) -> None:
    """A minute of transforms at 1 Hz; the server keeps the last ten seconds."""
    server = start_server("--cache-time", "10s")
    log: Log = [
        (100.0, "/tf_static", [("b", "c", 0.0, 1.0)]),
        *[(101.0 + i, "/tf", [("a", "b", 1.0 + i, 1.0)]) for i in range(60)],
    ]
    path = write(tmp_path / "log", log)
    done = zenoh_tf("--connect", server.endpoint, "replay", str(path), "--json")
    summary = json.loads(done.stdout)
    with server.connect() as tf:
        kept = tf.frame("b").samples
    assert summary["transforms"] == 61
    assert summary["dropped_as_too_old"] == 0
    assert summary["no_longer_kept"] == 60 - kept > 40
    done = zenoh_tf("--connect", server.endpoint, "replay", str(path))
    # By now all but the newest are too old on arrival, or rewrite what is there.
    assert "of them dropped on arrival" in done.stdout


@pytest.mark.parametrize("restarted", [False, True])
def test_a_server_that_dies(start_server: Any, tmp_path: Path, restarted: bool) -> None:
    log = [(float(i), "/tf", [("a", "b", 1.0 + i, 1.0)]) for i in range(120)]
    path = write(tmp_path / "log", log)
    server = start_server()
    options = ("--connect", server.endpoint, "--timeout", "2s")
    with begun(*options, "replay", str(path), "--rate", "30") as process:
        with server.connect() as tf:
            while not tf.can_transform("a", "b"):
                assert process.poll() is None
        server.kill()
        if restarted:
            start_server(endpoint=server.endpoint)
        out, err = process.communicate(timeout=150)
    assert process.returncode == 1
    assert out == ""
    said = "zenoh-tf: the server was restarted" if restarted else "zenoh-tf: ServerUnavailable: "
    assert err.startswith(said)


def test_a_loop_survives_the_server(start_server: Any, tmp_path: Path) -> None:
    """It continues where it was, with its static links, and says so once."""
    log: Log = [
        (0.0, "/tf_static", [("b", "camera", 0.0, 1.0)]),
        *[(i / 20, "/tf", [("a", "b", 1.0 + i / 20, float(i))]) for i in range(20_000)],
    ]
    path = write(tmp_path / "log", log)
    server = start_server()
    options = ("--connect", server.endpoint, "--timeout", "1s", "replay", str(path), "--loop")
    with begun(*options) as process:

        def wait_for_answers() -> int:
            with server.connect() as tf:
                while not tf.can_transform("a", "camera"):
                    assert process.poll() is None, process.communicate()
                    time.sleep(0.05)
                stamp_ns: int = tf.lookup_transform("a", "b").stamp_ns
                while tf.lookup_transform("a", "b").stamp_ns == stamp_ns:
                    time.sleep(0.05)
                return stamp_ns

        first_ns = wait_for_answers()
        server.kill()
        server = start_server(endpoint=server.endpoint)
        assert process.stderr is not None
        said = process.stderr.readline()
        assert wait_for_answers() > first_ns
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert (out, err) == ("", "interrupted\n")
    assert said.endswith(("(waiting)\n", "the server was restarted; replay continues\n"))
