"""The flags agree with the table of limits."""

from __future__ import annotations

import argparse
from dataclasses import fields

import pytest

from zenoh_tf_server import limits


def test_each_limit_is_a_flag() -> None:
    parser = argparse.ArgumentParser()
    limits.add_flags(parser)
    for entry in fields(limits.Limits):
        flag = f"--max-{entry.name.replace('_', '-')}"
        number = "7000000"
        assert getattr(limits.from_flags(parser.parse_args([flag, number])), entry.name) == 7000000
    assert limits.from_flags(parser.parse_args([])) == limits.Limits()


@pytest.mark.parametrize(
    ("text", "value"),
    [("1048576", 1 << 20), ("1M", 1 << 20), ("512MB", 512 << 20), ("4g", 4 << 30)],
)
def test_numbers_of_bytes(text: str, value: int) -> None:
    parser = argparse.ArgumentParser()
    limits.add_flags(parser)
    assert limits.from_flags(parser.parse_args(["--max-memory", text])).memory == value


@pytest.mark.parametrize("text", ["", "0", "1023K", "-1M", "1T", "1.5G", "M", "9" * 30])
def test_what_is_no_number_of_bytes(text: str) -> None:
    parser = argparse.ArgumentParser()
    limits.add_flags(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["--max-memory", text])
