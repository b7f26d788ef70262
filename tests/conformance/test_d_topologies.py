"""D: lookups in trees of several shapes, constant and moving."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from zenoh_tf import ConnectivityException, StampedTransform, errors

from .conftest import MakeTree
from .shorthand import (
    NO_ROTATION,
    Tree,
    assert_pose,
    can,
    look,
    ns,
    put,
    stamped,
    x_of,
    yaw,
)

#: parent, child, pose of child in parent
Link = tuple[str, str, Sequence[float], Sequence[float]]
#: (target, source) -> pose of source in target, or None if they are not connected
Expected = Callable[[str, str], tuple[Sequence[float], Sequence[float]] | None]

ONE_LINK = {"1": (0, 0), "2": (1, 0)}
ONE_LINK_TREE = (("1", "2"),)
V = {"a": (0, 0), "b": (1, 0), "c": (2, 0), "f": (0, 1), "g": (0, 2)}
V_TREE = (("a", "b"), ("b", "c"), ("a", "f"), ("f", "g"))
#: yaw per second of the helix
TURN = 0.25


def links(positions: dict[str, tuple[int, int]], edges: Sequence[tuple[str, str]]) -> list[Link]:
    """Links without rotation between frames at these places in the plane."""
    return [(p, c, (*np.subtract(positions[c], positions[p]), 0.0), NO_ROTATION) for p, c in edges]


def differences(positions: dict[str, tuple[int, int]]) -> Expected:
    """Without rotations, the pose of one frame in another is the difference of their places."""
    return lambda target, source: (
        (*np.subtract(positions[source], positions[target]), 0.0),
        NO_ROTATION,
    )


def filled(make_tf: MakeTree, tree: Sequence[Link]) -> Iterator[tuple[Tree, float]]:
    """Yield trees filled as upstream does (one sample per link, or two of the same pose), and the
    stamp T of their newest samples."""
    for newest in (1.0, 10.0):
        for before in (None, 0.5, 0.05, 0.0005):
            tf = make_tf()
            for parent, child, xyz, q in tree:
                if before is not None:
                    assert put(tf, parent, child, newest - before, xyz, q)
                assert put(tf, parent, child, newest, xyz, q)
            yield tf, newest


def check_all_pairs(make_tf: MakeTree, tree: Sequence[Link], expected: Expected) -> None:
    """Every ordered pair of frames, at T and at the latest common time."""
    names = sorted({name for link in tree for name in link[:2]})
    pairs = list(itertools.product(names, repeat=2))
    targets, sources = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    for tf, newest in filled(make_tf, tree):
        for stamp_ns in (ns(newest), None):
            found = tf.lookup_transforms(targets, sources, stamp_ns)
            for row, (target, source) in enumerate(pairs):
                pose = expected(target, source)
                if pose is None:
                    assert found.status[row] == ConnectivityException.code
                    continue
                assert found.status[row] == 0, errors.BY_CODE[int(found.status[row])]
                if target != source or stamp_ns is not None:
                    assert found.stamps_ns[row] == ns(newest)
                assert_pose(found[row], *pose)


def test_D01_i_configuration(make_tf: MakeTree) -> None:
    """Three frames in a row."""
    positions = {"a": (0, 0), "b": (1, 0), "c": (2, 0)}
    edges = (("a", "b"), ("b", "c"))
    check_all_pairs(make_tf, links(positions, edges), differences(positions))


def test_D02_one_link_configuration(make_tf: MakeTree) -> None:
    """A single link, in both directions."""
    check_all_pairs(make_tf, links(ONE_LINK, ONE_LINK_TREE), differences(ONE_LINK))


def test_D03_v_configuration(make_tf: MakeTree) -> None:
    """Two branches from the root."""
    check_all_pairs(make_tf, links(V, V_TREE), differences(V))


def test_D04_y_configuration(make_tf: MakeTree) -> None:
    """Two branches from below the root."""
    positions = {"a": (0, 0), "b": (1, 0), "c": (2, 0), "d": (1, 1), "e": (1, 2)}
    edges = (("a", "b"), ("b", "c"), ("b", "d"), ("d", "e"))
    check_all_pairs(make_tf, links(positions, edges), differences(positions))


def test_D05_multi_configuration(make_tf: MakeTree) -> None:
    """Two trees side by side: lookups within each succeed, lookups between them fail."""
    tree = links(ONE_LINK, ONE_LINK_TREE) + links(V, V_TREE)
    places = ONE_LINK | V

    def apart(target: str, source: str) -> bool:
        return (target in ONE_LINK) != (source in ONE_LINK)

    check_all_pairs(
        make_tf,
        tree,
        lambda target, source: (
            None if apart(target, source) else differences(places)(target, source)
        ),
    )
    for tf, newest in filled(make_tf, tree):
        for seconds in (newest, None):
            for target, source in itertools.product(places, repeat=2):
                assert can(tf, target, source, seconds) is not apart(target, source)
            with pytest.raises(ConnectivityException):
                look(tf, "1", "g", seconds)


def test_D06_ring_45_configuration(make_tf: MakeTree) -> None:
    """A ring in steps of 45 degrees, and its mirror image: the frame k steps on stands k steps
    further round the circle of radius 1, turned by as much."""
    step = {"a": 0} | {name: k for k, name in enumerate("bcdefghi", start=1)}
    step |= {f"inverse_{name}": -k for name, k in step.items() if k}
    by_step = {k: name for name, k in step.items()}

    def on_circle(k: int) -> tuple[Sequence[float], Sequence[float]]:
        angle = k * math.pi / 4
        return (math.cos(angle) - 1, math.sin(angle), 0), yaw(angle)

    tree: list[Link] = []
    for direction in (1, -1):
        xyz = (math.sqrt(2) / 2 - 1, direction * math.sqrt(2) / 2, 0)
        q = (0, 0, direction * math.sin(math.pi / 8), math.cos(math.pi / 8))
        for k in range(8):
            tree.append((by_step[direction * k], by_step[direction * (k + 1)], xyz, q))
    check_all_pairs(make_tf, tree, lambda target, source: on_circle(step[source] - step[target]))


#: (target, source): pose of source in target
COMPOUND = """
root,c -0.745017618  1.576899311  0.303216232 |  0.721690099  0.179191798  0.370252869  0.556746363
root,d  0.840334114  1.221848588 -0.624468450 |  0.863061836  0.466404392  0.082369842  0.175517577
a,b    -2.449006006 -0.511845174 -1.655410553 |  0.105332018  0.344269544 -0.248214474  0.899318198
b,a     0.263709767  1.739090607  2.430230651 | -0.105332018 -0.344269544  0.248214474  0.899318198
a,c    -1.127597474  1.017154105 -1.247929639 |  0.551560630  0.017343779  0.122706010  0.824877748
c,a     1.000807425  0.566512867  1.594005831 | -0.551560630 -0.017343779 -0.122706010  0.824877748
a,d    -0.213693517 -0.592036219 -1.522312692 |  0.882931983  0.161872743 -0.089907168  0.431445279
d,a    -0.131981856  0.852560547 -1.403327844 |  0.882931983  0.161872743 -0.089907168 -0.431445279
c,b    -1.663094586 -0.682954054  1.008806303 | -0.362593555  0.118552507 -0.503157016  0.775438092
b,d     1.370619388  1.094004739  1.394748613 |  0.739364941  0.206728029  0.313152019  0.559051715
d,b    -2.025609232 -0.956033022  0.060627300 | -0.739364941 -0.206728029 -0.313152019  0.559051715
"""


def test_D07_compound_configuration(tf: Tree) -> None:
    """Rotations about all axes, over up to three links and back."""
    put(tf, "root", "a", 1, (1, 1, 1), (0.272660403, 0.022494047, 0.323415536, 0.905843648))
    put(tf, "root", "b", 1, (-1, 0, -1), (0.223697334, 0.433827955, 0.157509302, 0.858454208))
    put(tf, "b", "c", 1, (0, 2, 0.5), (0.362593555, -0.118552507, 0.503157016, 0.775438092))
    put(tf, "c", "d", 1, (0.5, -1, 1.5), (0.511764805, -0.031887983, -0.201072606, 0.834655467))
    for line in COMPOUND.strip().splitlines():
        pair, *numbers = line.replace("|", " ").split()
        target, source = pair.split(",")
        pose = [float(number) for number in numbers]
        for seconds in (1, None):
            assert_pose(look(tf, target, source, seconds), pose[:3], pose[3:], tolerance=2e-5)


def helix(tf: Tree) -> list[float]:
    """Six seconds of a helix: c climbs and turns about a's z axis, d is measured half a step
    later than the others. Returns the times of its steps but the last."""
    steps = [10 + 0.05 * k for k in range(101)]
    rows: list[StampedTransform] = []
    for t in steps:
        dt = t - 10
        turned = TURN * dt
        rows += [
            stamped("a", "b", t, (0, 0, dt)),
            stamped("b", "c", t, (math.cos(turned), math.sin(turned), 0), yaw(turned)),
            stamped("a", "d", t + 0.025, (0, 0, math.cos(TURN * (dt + 0.025)))),
        ]
    tf.set_transforms_xact(rows)
    return steps[:-1]


def test_D08_helix_configuration(tf: Tree) -> None:
    """A moving tree, asked halfway between the samples of its links."""
    halves = [t + 0.025 for t in helix(tf)]
    stamps_ns = [ns(t) for t in halves]
    pairs = ("ab", "ac", "ad", "cd")
    found = {pair: tf.sample(pair[0], pair[1], stamps_ns) for pair in pairs}
    for row, t in enumerate(halves):
        dt = t - 10
        turned = TURN * dt
        z = math.cos(turned)
        expected = {
            "ab": ((0, 0, dt), NO_ROTATION),
            "ac": ((math.cos(turned), math.sin(turned), dt), yaw(turned)),
            "ad": ((0, 0, z), NO_ROTATION),
            "cd": ((-1, 0, z - dt), yaw(-turned)),
        }
        for pair in pairs:
            assert found[pair].status[row] == 0
            assert_pose(found[pair][row], *expected[pair], tolerance=2e-5)


def test_D09_helix_advanced(tf: Tree) -> None:
    """d at one time in c at an earlier one, through the fixed frame a. The result has the stamp
    of the target."""
    for t in helix(tf)[1:]:
        dt, later = t - 10, t - 10 + 0.05
        answer = tf.lookup_transform_full("c", ns(t), "d", ns(t + 0.05), "a")
        expected = (-1, 0, math.cos(TURN * later) - dt)
        assert_pose(answer, expected, yaw(-TURN * dt), tolerance=2e-5)
        assert answer.stamp_ns == ns(t)


def test_D10_reparent_in_time(tf: Tree) -> None:
    """At each time the parent is the one of that time."""
    put(tf, "p1", "c", 10, (1, 0, 0))
    put(tf, "p2", "c", 20, (2, 0, 0))
    for seconds in (10, 20):
        put(tf, "w", "p1", seconds, (seconds, 0, 0))
        put(tf, "w", "p2", seconds, (10 * seconds, 0, 0))
    for at, x in ((10, 11), (15, 16), (20, 202), (None, 202)):
        assert x_of(look(tf, "w", "c", at)) == pytest.approx(x, abs=1e-6)
    assert [tf.parent("c", ns(at)) for at in (10, 15, 20)] == ["p1", "p1", "p2"]
