"""TransformArray: its laws, row by row against Transform, and rows that failed."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from zenoh_tf import (
    ForwardExtrapolationException,
    InvalidArgumentException,
    LookupException,
    StampedTransform,
    Transform,
    TransformArray,
    TransformException,
    TransformTree,
)
from zenoh_tf.errors import BY_CODE

Array = NDArray[np.float64]
RNG = np.random.default_rng(11)
ROWS = 7
POINTS = RNG.normal(size=(ROWS, 5, 3))
FORWARD = ForwardExtrapolationException.code


def random_array(failed: dict[int, int] | None = None) -> TransformArray:
    poses = RNG.normal(size=(ROWS, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    status = np.zeros(ROWS, np.uint8)
    for row, code in (failed or {}).items():
        status[row] = code
        poses[row] = np.nan
    return TransformArray(status, np.arange(ROWS), poses)


A, B, C = random_array(), random_array(), random_array()
X = Transform((1, -2, 3), (0.1, -0.5, 0.7, 0.5))
EMPTY = TransformArray(np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros((0, 7)))


def assert_same(got: TransformArray, expected: TransformArray | list[Transform]) -> None:
    rows = np.array([row.pose() for row in expected])
    np.testing.assert_allclose(got.poses, rows, rtol=0, atol=1e-13)


def test_composition_is_that_of_the_rows() -> None:
    assert_same(A @ B, [a @ b for a, b in zip(A, B, strict=True)])
    assert_same(A @ X, [a @ X for a in A])
    assert_same(X @ A, [X @ a for a in A])


def test_composition_is_associative() -> None:
    assert_same((A @ B) @ C, A @ (B @ C))
    assert_same((X @ A) @ B, X @ (A @ B))
    assert_same((A @ X) @ B, A @ (X @ B))
    assert_same((A @ B) @ X, A @ (B @ X))


def test_the_inverse_undoes() -> None:
    assert_same(A.inverse(), [a.inverse() for a in A])
    identity = np.tile([0.0, 0, 0, 0, 0, 0, 1], (ROWS, 1))
    np.testing.assert_allclose((A @ A.inverse()).poses, identity, atol=1e-13)
    np.testing.assert_allclose((A.inverse() @ A).poses, identity, atol=1e-13)
    assert_same((A @ B).inverse(), B.inverse() @ A.inverse())


@pytest.mark.parametrize(
    ("points", "expected_points"),
    [
        (POINTS[0, 0], [POINTS[0, 0]] * ROWS),  # (3,)
        (POINTS[:, 0], POINTS[:, 0]),  # (n, 3)
        (POINTS[:1, 0], [POINTS[0, 0]] * ROWS),  # (1, 3)
        (POINTS, POINTS),  # (n, m, 3)
        (POINTS[:1], [POINTS[0]] * ROWS),  # (1, m, 3)
        (POINTS[:, :0], POINTS[:, :0]),  # no points
        ([1, 2, 3], [[1, 2, 3]] * ROWS),
        (POINTS.astype(np.float32), POINTS.astype(np.float32)),
    ],
)
def test_apply_is_that_of_the_rows(points: Any, expected_points: Any) -> None:
    expected = np.array([a.apply(p) for a, p in zip(A, expected_points, strict=True)])
    got = A.apply(points)
    assert got.shape == expected.shape
    assert got.dtype == np.float64
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose((A @ B).apply(points), A.apply(B.apply(points)), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "points",
    [
        1.0,
        [],
        [1, 2],
        np.zeros((ROWS - 1, 3)),
        np.zeros((2, 5, 3)),
        np.zeros((ROWS, 3, 3, 3)),
        np.zeros(3, complex),
        ["a", "b", "c"],
        [[1, 2, 3], [4]],
        None,
    ],
)
def test_invalid_points(points: Any) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        A.apply(points)
    assert caught.value.field == "points"


def test_no_rows() -> None:
    assert EMPTY.raise_for_status() is EMPTY
    assert EMPTY.apply((1, 2, 3)).shape == (0, 3)
    assert EMPTY.apply(np.zeros((0, 4, 3))).shape == (0, 4, 3)
    assert len(EMPTY @ EMPTY) == len(X @ EMPTY) == len(EMPTY @ X) == len(EMPTY.inverse()) == 0
    assert list(EMPTY) == []


def test_rows_that_failed_stay_failed() -> None:
    bad = random_array({1: FORWARD, 4: LookupException.code})
    assert bad.ok.tolist() == [True, False, True, True, False, True, True]
    also = random_array({1: LookupException.code, 2: FORWARD})
    for made in (bad.inverse(), bad @ X, X @ bad, bad @ A, A @ bad):
        np.testing.assert_array_equal(made.status, bad.status)
        assert np.isnan(made.poses[~bad.ok]).all()
        assert np.isfinite(made.poses[bad.ok]).all()
    assert (bad @ also).status[[1, 2, 4]].tolist() == [FORWARD, FORWARD, LookupException.code]
    for points in (POINTS, POINTS[:, 0], POINTS[0, 0]):
        moved = bad.apply(points)
        assert np.isnan(moved[~bad.ok]).all()
        assert np.isfinite(moved[bad.ok]).all()


def test_raise_for_status() -> None:
    assert A.raise_for_status() is A
    bad = random_array({3: FORWARD, 5: LookupException.code})
    with pytest.raises(ForwardExtrapolationException, match="row 3 of 7") as caught:
        bad.raise_for_status()
    assert caught.value.value == 3
    unknown = random_array({2: 250})
    with pytest.raises(TransformException, match="row 2"):
        unknown.raise_for_status()


def test_rows_know_their_frames() -> None:
    tree = TransformTree()
    for stamp_ns in (10, 20):
        tree.set_transform(StampedTransform("map", "base", stamp_ns, X))
    many = tree.lookup_transforms("map", ["base", "<b>", "base"], [10, 10, 30])
    assert [many.frames_of(row) for row in range(3)] == [
        ("map", "base"),
        ("map", "<b>"),
        ("map", "base"),
    ]
    assert many.inverse().frames_of(1) == ("<b>", "map")
    assert many[1:].frames_of(0) == ("map", "<b>")
    assert many[many.ok].frames_of(0) == many[[-1]].frames_of(0) == ("map", "base")
    assert (many.inverse() @ many).frames_of(1) == ("<b>", "<b>")
    assert (X @ many).frames_of(1) == (None, "<b>")
    assert (many @ X).frames_of(1) == ("map", None)
    assert A.frames_of(0) == (None, None)
    with pytest.raises(ForwardExtrapolationException) as caught:
        many[2]
    assert str(caught.value) == (
        "row 2 of 3 ('base' in 'map' at 0.000000030 s) failed with ForwardExtrapolationException: "
        "the requested time is newer than the link's newest sample; 2 rows failed in all; "
        "lookup_transform of the row says more"
    )
    assert (caught.value.target_frame, caught.value.source_frame) == ("map", "base")
    assert caught.value.stamp_ns == 30
    assert (many.stamps_ns.tolist(), many.inverse()[2:].stamps_ns.tolist()) == ([10, 10, 30], [30])
    latest = tree.lookup_transforms("map", ["base", "<b>"], None)
    with pytest.raises(
        LookupException, match=r"^row 1 of 2 \('<b>' in 'map'\).*; 1 row failed"
    ) as one:
        latest.raise_for_status()
    assert one.value.stamp_ns is None


@pytest.mark.parametrize("code", BY_CODE)
def test_the_error_of_a_row_is_one_line(code: int) -> None:
    with pytest.raises(
        TransformException, match=r"^row 1 of 7 failed with [^\n`]*; 1 row failed in all$"
    ):
        random_array({1: code}).raise_for_status()


def test_in_a_notebook() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("<map>", "base", 10, Transform((1, 2.5, 3))))
    assert "\n&lt;map&gt;\n" in tree._repr_html_()
    latest = tree.lookup_latest_transform("<map>", "base")
    for shown, cell in (
        (tree.lookup_transform("<map>", "base"), "<td>1, 2.5, 3</td>"),
        (latest, "<th>newest [ns]</th>"),
        (tree.sample("<map>", "base", [10, 20]), "<td>NoDataForExtrapolationException</td>"),
    ):
        html = shown._repr_html_()
        assert cell in html and "<td>&lt;map&gt;</td>" in html
    assert A._repr_html_().count("<tr>") == 1 + ROWS


def test_rows() -> None:
    bad = random_array({1: FORWARD})
    assert bad[0] == Transform.from_pose(bad.poses[0])
    assert bad[-1] == bad[np.int64(ROWS - 1)] == Transform.from_pose(bad.poses[-1])
    for row in (1, 1 - ROWS):
        with pytest.raises(ForwardExtrapolationException, match="row 1 of 7"):
            bad[row]
    for row in (ROWS, -ROWS - 1):
        with pytest.raises(IndexError):
            bad[row]
    with pytest.raises(ForwardExtrapolationException):
        list(bad)
    for rows in (slice(2, 5), slice(None, None, -2), bad.ok, [3, 1, 1], np.array([0, 6])):
        part = bad[rows]
        assert isinstance(part, TransformArray)
        np.testing.assert_array_equal(part.status, bad.status[rows])
        np.testing.assert_array_equal(part.stamps_ns, bad.stamps_ns[rows])
        np.testing.assert_array_equal(part.poses, bad.poses[rows])
    assert [*bad[bad.ok]] == [bad[i] for i in range(ROWS) if i != 1]


def test_operands_that_do_not_fit() -> None:
    with pytest.raises(InvalidArgumentException, match="7 rows with 2"):
        A @ A[:2]
    for other in (3, np.eye(4), "x"):
        with pytest.raises(TypeError):
            A @ other  # type: ignore[operator]
        with pytest.raises(TypeError):
            other @ A  # type: ignore[operator]


def test_repr_and_pickle() -> None:
    assert repr(A) == "TransformArray(7 rows)"
    failed = random_array({1: FORWARD, 2: LookupException.code, 4: 250, 5: FORWARD})
    assert repr(failed) == (
        "TransformArray(7 rows, 4 failed with LookupException, ForwardExtrapolationException, "
        "TransformException)"
    )
    named = TransformArray(A.status, A.stamps_ns, A.poses, "map", "tool")
    assert repr(named[:2]) == "TransformArray(2 rows of 'tool' in 'map')"
    copy = pickle.loads(pickle.dumps(A))
    np.testing.assert_array_equal(copy.poses, A.poses)
