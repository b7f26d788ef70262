"""docs/limits.md and the flags agree with the table of limits."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from zenoh_tf_server import limits

PAGE = Path(__file__).resolve().parent.parent / "docs" / "limits.md"


def test_the_page_is_made_from_the_table() -> None:
    assert PAGE.read_text().splitlines() == list(limits.page())


def test_each_limit_is_a_flag() -> None:
    parser = argparse.ArgumentParser()
    limits.add_flags(parser)
    for entry in fields(limits.Limits):
        flag = f"--max-{entry.name.replace('_', '-')}"
        assert getattr(limits.from_flags(parser.parse_args([flag, "7"])), entry.name) == 7
    assert limits.from_flags(parser.parse_args([])) == limits.Limits()
