"""Text that others have chosen never reaches a terminal, a log or an error raw or at length."""

from __future__ import annotations

import sys
import unicodedata

import pytest

from zenoh_tf import wire
from zenoh_tf.errors import MAX_FACT_CHARS, MAX_MESSAGE_CHARS, LookupException, ProtocolError
from zenoh_tf.text import cut, printable, quoted

HOSTILE = "\n\r\x1b[31m\x00\x7f\x85\x9b\u2028\u2029\u202e\u2066\u200e\ud800"


def test_printable_escapes_every_control_and_format_character() -> None:
    raw = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    for code in range(sys.maxunicode + 1):
        char = chr(code)
        if unicodedata.category(char) in raw:
            shown = printable(char)
            assert shown.startswith("\\") and shown.isascii(), hex(code)
    assert printable("Grüße, 世界 \\ '") == "Grüße, 世界 \\ '"
    assert printable("a\nb") == "a\\nb"


def test_cut_keeps_the_beginning_and_the_length_once() -> None:
    assert cut("x" * 50, 50) == "x" * 50
    short = cut("x" * 1_048_576, 50)
    assert len(short) == 50
    assert short.endswith("x... (1,048,576 characters)")
    assert cut(short, 50) == short


def test_quoted_is_short_and_printable_whatever_the_value() -> None:
    assert quoted("base_link") == "'base_link'"
    assert quoted(HOSTILE).isprintable()
    assert quoted("x" * 1000) == f"'{'x' * 100}'... (1,000 characters)"
    nested: object = "\n" * 10_000
    for _ in range(50):
        nested = [nested, {"key": nested}, b"\0" * 10_000_000]
    for value in (nested, None, 2**63, b"\x1b" * 100, {HOSTILE: HOSTILE}, [HOSTILE] * 9):
        assert quoted(value).isprintable()
        assert len(quoted(value)) < 500


def test_an_error_never_repeats_megabytes() -> None:
    name = "x" * 1_000_000
    error = LookupException(f"frame {name!r} does not exist", frame=name, stamp_ns=1)
    assert len(str(error)) == MAX_MESSAGE_CHARS
    assert error.frame is not None and len(error.frame) == MAX_FACT_CHARS
    assert error.stamp_ns == 1
    again = wire.decode_error(wire.encode_error(error))
    assert (str(again), again.facts) == (str(error), error.facts)


@pytest.mark.parametrize("size", [10, 100_000])
def test_a_malformed_message_is_named_but_not_repeated(size: int) -> None:
    long = HOSTILE[:-1] * size
    for message in ({"v": long}, {"v": [long] * 3}, {"v": long.encode()}):
        with pytest.raises(ProtocolError) as caught:
            wire.unpack(wire.pack(message))
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) <= 1000  # an escape has up to ten characters
