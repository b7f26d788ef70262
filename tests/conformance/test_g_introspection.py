"""G: introspection."""

from __future__ import annotations

import re

import pytest

from zenoh_tf import FrameInfo, InvalidArgumentException, LookupException, export

from .shorthand import Tree, can, ns, put

NOW_S = 13


def infos(tf: Tree) -> list[FrameInfo]:
    return [tf.frame(name) for name in tf.frames()]


def put_foo_bar(tf: Tree) -> None:
    """The link of tf2's own examples: three samples in two seconds, by two authorities."""
    for seconds, authority in ((10, "me"), (11, "me"), (12, "you")):
        put(tf, "foo", "bar", seconds, authority=authority)


def put_v(tf: Tree) -> None:
    """a over b over c, and a over f over g."""
    for parent, child in (("a", "b"), ("b", "c"), ("a", "f"), ("f", "g")):
        put(tf, parent, child, 1)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?", text)]


@pytest.mark.own_server
def test_G01_frames(tf: Tree) -> None:
    """Frames are listed in the order of their first mention, the child first, without slash.
    Neither a new parent nor a clear removes a name."""
    assert tf.frames() == []
    put(tf, "/parent", "/b", 4e-6)
    assert tf.frames() == ["b", "parent"]
    put(tf, "/frame", "/other", 4e-6)
    assert tf.frames() == ["b", "parent", "other", "frame"]
    assert tf.frame("b").name == "b"
    with pytest.raises(LookupException) as caught:
        tf.frame("zz")
    assert caught.value.frame == "zz"
    with pytest.raises(InvalidArgumentException):
        tf.frame("/b")
    put(tf, "other", "b", 2)
    tf.clear()
    assert tf.frames() == ["b", "parent", "other", "frame"]
    assert tf.frame("parent").parent is None
    assert not can(tf, "other", "b")


@pytest.mark.own_server
def test_G02_figures_of_links(tf: Tree) -> None:
    """Parent, last authority, samples / (newest - oldest) as rate, both stamps and the delay, as
    data and as text. [Q] Decision: a static link has neither rate nor delay, where tf2 shows
    10000 Hz at time 0."""
    assert infos(tf) == []
    assert "bar" not in export.text([], now_ns=ns(NOW_S))
    put_foo_bar(tf)
    put(tf, "bar", "camera", 10, static=True, authority="urdf")
    bar = tf.frame("bar")
    assert (bar.name, bar.parent, bar.authority, bar.static) == ("bar", "foo", "you", False)
    assert (bar.oldest_stamp_ns, bar.newest_stamp_ns, bar.samples) == (ns(10), ns(12), 3)
    assert bar.rate_hz == pytest.approx(1.5)
    assert bar.delay_s(ns(NOW_S)) == pytest.approx(1.0)
    foo, camera = tf.frame("foo"), tf.frame("camera")
    assert (foo.parent, foo.authority, foo.samples) == (None, "", 0)
    assert (foo.oldest_stamp_ns, foo.newest_stamp_ns) == (None, None)
    assert (camera.parent, camera.authority) == ("bar", "urdf")
    assert (camera.static, camera.samples) == (True, 1)
    for without in (foo, camera):
        assert without.rate_hz is None
        assert without.delay_s(ns(NOW_S)) is None
    lines = export.text(infos(tf), now_ns=ns(NOW_S)).splitlines()
    (bar_line,) = (line for line in lines if "bar" in line)
    assert "you" in bar_line
    assert {1.5, 1.0, 12.0, 2.0, 3.0} <= set(numbers(bar_line))
    (camera_line,) = (line for line in lines if "camera" in line)
    assert "urdf" in camera_line
    assert "static" in camera_line
    assert numbers(camera_line) == [1.0]  # the number of samples


def test_G03_chain_is_whole(tf: Tree) -> None:
    """[Q] Decision: every frame between the two with the common ancestor, target first.
    Chain and parent are those of the time asked for."""
    put_v(tf)
    for stamp_ns in (None, ns(1)):
        assert tf.chain("c", "g", stamp_ns) == ["c", "b", "a", "f", "g"]
        assert tf.chain("g", "c", stamp_ns) == ["g", "f", "a", "b", "c"]
        assert tf.chain("a", "g", stamp_ns) == ["a", "f", "g"]
        assert tf.chain("c", "a", stamp_ns) == ["c", "b", "a"]
        assert tf.chain("c", "c", stamp_ns) == ["c"]
        assert tf.parent("c", stamp_ns) == "b"
        assert tf.parent("a", stamp_ns) is None
    with pytest.raises(LookupException):
        tf.chain("c", "nowhere")
    put(tf, "f", "c", 2)
    assert tf.chain("a", "c", ns(1)) == ["a", "b", "c"]
    assert tf.chain("f", "c", ns(2)) == ["f", "c"]
    assert tf.chain("a", "c") == ["a", "f", "c"]
    assert (tf.parent("c", ns(1)), tf.parent("c")) == ("b", "f")


def test_G04_all_frames_as_text(tf: Tree) -> None:
    """Every frame has its line under its parent's, indented deeper."""
    put_v(tf)
    lines = export.text(infos(tf), now_ns=ns(NOW_S)).splitlines()
    row, depth = {}, {}
    for i, line in enumerate(lines):
        found = re.match(r"([^a-z]*)([abcfg])(?=\s|$)", line)
        if found:
            row[found[2]], depth[found[2]] = i, len(found[1])
    assert [name for name, _ in sorted(row.items(), key=lambda item: item[1])] == [*"abcfg"]
    assert depth["a"] < depth["b"] < depth["c"]
    assert depth["b"] == depth["f"] < depth["g"] == depth["c"]


def test_G05_all_frames_as_dot(tf: Tree) -> None:
    """One edge per link, labelled with authority, rate, newest stamp, age and span."""
    empty = export.dot(infos(tf), now_ns=ns(NOW_S))
    assert empty.startswith("digraph")
    assert "->" not in empty
    put_foo_bar(tf)
    put(tf, "bar", "camera", 0, static=True, authority="urdf")
    dot = export.dot(infos(tf), now_ns=ns(NOW_S))
    names = dict(re.findall(r'^ *(\w+) \[label="(\w+)"', dot, re.MULTILINE))
    edges = {
        (names[parent], names[child]): label
        for parent, child, label in re.findall(r'(\w+) -> (\w+) \[label="([^"]*)"', dot)
    }
    assert edges.keys() == {("foo", "bar"), ("bar", "camera")}
    moving, static = edges["foo", "bar"], edges["bar", "camera"]
    assert "you" in moving
    assert {1.5, 12.0, 1.0, 2.0} <= set(numbers(moving))
    assert "urdf" in static
    assert "static" in static
