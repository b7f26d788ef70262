"""``--limit NAME=VALUE``, ``--max-memory`` and their list agree with the table of limits."""

from __future__ import annotations

from dataclasses import fields

import pytest

from zenoh_tf import wire
from zenoh_tf_server import flags, limit_flags
from zenoh_tf_server.limits import Limits

NAMES = [entry.name for entry in fields(Limits) if entry.name != "memory"]


def parse(*arguments: str) -> Limits:
    return limit_flags.from_flags(flags.parser().parse_args(arguments))


def error(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as caught:
        parse(*arguments)
    assert caught.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_each_limit_is_set_by_its_name() -> None:
    for name in NAMES:
        assert parse("--limit", f"{name}=7000000") == Limits(**{name: 7_000_000})
    assert parse() == Limits()
    assert parse("--limit", "rows=1", "--limit", "rows=2", "--limit", "frames=3") == Limits(
        rows=2, frames=3
    )


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("row=1", "there is no limit 'row': did you mean rows?"),
        ("max-frames=1", "there is no limit 'max-frames': did you mean frames or "),
        ("samples-per-frame=1", "did you mean samples_per_frame"),
        ("zzzz=1", "there is no limit 'zzzz': --limit help lists all"),
        ("memory=1G", "memory has a flag of its own, --max-memory"),
        ("rows", "'rows' is not NAME=VALUE or help"),
        ("rows=", "the limit rows is '': it must be a whole number from 1 to"),
        ("rows=1.5", "the limit rows is '1.5'"),
        ("rows=0", "the limit rows is 0: it must be a whole number from 1 to"),
        ("rows=-1", "the limit rows is '-1'"),
        ("rows=\u0661", "the limit rows is '\u0661'"),
        ("rows=" + "9" * 5000, "the limit rows is '9999"),
        ("reply_bytes=999999999", f"from 1 to {wire.MAX_REPLY_BYTES:,}"),
    ],
)
def test_mistakes_name_limit_and_value(
    capsys: pytest.CaptureFixture[str], given: str, expected: str
) -> None:
    assert expected in error(capsys, "--limit", given)


def test_the_list_has_each_limit_with_its_default(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parse("--limit", "help")
    assert caught.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    for name in NAMES:
        assert [name, str(getattr(Limits(), name))] in [line.split()[:2] for line in lines], name


def test_help_fits_on_two_screens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = flags.parser().format_help().splitlines()
    assert len(lines) <= 100
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize(
    ("text", "value"),
    [("1048576", 1 << 20), ("1M", 1 << 20), ("512MB", 512 << 20), ("4g", 4 << 30)],
)
def test_numbers_of_bytes(text: str, value: int) -> None:
    assert parse("--max-memory", text).memory == value


@pytest.mark.parametrize("text", ["", "0", "1023K", "-1M", "1T", "1.5G", "M", "9" * 30])
def test_what_is_no_number_of_bytes(capsys: pytest.CaptureFixture[str], text: str) -> None:
    assert "--max-memory" in error(capsys, "--max-memory", text)
