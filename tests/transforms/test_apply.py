"""The arguments of Transform's apply methods. Their results are in test_transform_laws.py."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.threads import switching
from zenoh_tf import InvalidArgumentException, Transform

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)
METHODS: list[tuple[str, str, tuple[int, ...]]] = [
    ("apply", "points", (3,)),
    ("apply_vectors", "vectors", (3,)),
    ("apply_poses", "poses", (7,)),
    ("apply_covariance", "covariance", (6, 6)),
    ("apply_wrench", "wrench", (6,)),
    ("apply_twist", "twist", (6,)),
]
methods = pytest.mark.parametrize(("method", "field", "tail"), METHODS)
A = Transform((1, -2, 3), (0.1, -0.5, 0.7, 0.5))


def bound(method: str) -> Callable[[Any], Array]:
    function: Callable[[Any], Array] = getattr(A, method)
    return function


def assert_same(got: Array, expected: Array) -> None:
    """Equal within some ulp of the largest number.

    Not bit for bit: compilers may fuse a product and a sum into one rounding (as on aarch64), in
    the vectorised part of a loop and not in the rest of it.
    """
    ulp = np.finfo(np.float64).eps * max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(got, expected, rtol=0, atol=8 * ulp)


@methods
def test_any_leading_shape_and_no_input_is_modified(
    method: str, field: str, tail: tuple[int, ...]
) -> None:
    for leading in [(), (1,), (5,), (2, 4), (0,), (3, 0), (4000,)]:  # the last: many numbers
        values = RNG.normal(size=leading + tail)
        before = values.copy()
        values.flags.writeable = False
        result = bound(method)(values)
        assert result.shape == values.shape
        assert result.dtype == np.float64
        assert result.flags.writeable
        np.testing.assert_array_equal(values, before)
        rows = values.reshape(-1, *tail)
        one_by_one = [bound(method)(row) for row in rows[:20]]
        for got, expected in zip(result.reshape(-1, *tail), one_by_one, strict=False):
            assert_same(got, expected)


@methods
def test_any_strides_and_real_dtypes(method: str, field: str, tail: tuple[int, ...]) -> None:
    values = RNG.integers(-9, 9, size=(4, *tail))
    expected = bound(method)(values.astype(float))
    spread = np.zeros((8, *(2 * n for n in tail)))
    every_other = spread[tuple([slice(None, None, -2)] * spread.ndim)]
    every_other[...] = values
    for form in (
        values,
        values.tolist(),
        values.astype(np.float32),
        values.astype(">f8"),
        values.astype(np.int8),
        np.asfortranarray(values, np.float64),
        every_other,
    ):
        assert_same(bound(method)(form), expected)
    repeated = bound(method)(np.broadcast_to(values, (3, *values.shape)))
    assert_same(repeated, np.broadcast_to(expected, repeated.shape))


@methods
def test_invalid_arguments(method: str, field: str, tail: tuple[int, ...]) -> None:
    wrong: list[Any] = [1.0, None, "abc", [], [[1, 2], [3]], np.zeros(tail[:-1]), np.zeros((2, 5))]
    wrong += [np.zeros(tail, complex), np.zeros(tail, str), np.zeros(tail, "M8[s]")]
    wrong += [np.zeros((*tail[:-1], tail[-1] + 1)), np.zeros((*tail, 1))]
    for values in wrong:
        with pytest.raises(InvalidArgumentException) as caught:
            bound(method)(values)
        assert caught.value.field == field


@methods
def test_other_threads_run_meanwhile(method: str, field: str, tail: tuple[int, ...]) -> None:
    values = np.ones((20_000, *tail))
    go, ran = threading.Event(), threading.Event()

    def other() -> None:
        go.wait()
        ran.set()

    thread = threading.Thread(target=other)
    thread.start()
    with switching(1000.0):  # from here on no thread is asked to release the GIL
        go.set()
        while not ran.is_set():  # never ends if the call keeps the GIL
            bound(method)(values)
    thread.join()
