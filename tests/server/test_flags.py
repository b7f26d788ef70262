"""Wrong flags are explained; ``--limit NAME=VALUE``, ``--max-memory`` and their list agree with the
table of limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from zenoh_tf import wire
from zenoh_tf_server import flags
from zenoh_tf_server.limits import SETTABLE, Limits

NAMES = [name for name in SETTABLE if name != "memory"]


def parse(*arguments: str) -> Limits:
    return flags.settings(flags.parse(arguments)).limits


def error(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as caught:
        flags.parse(arguments)
    assert caught.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_each_limit_is_set_by_its_name() -> None:
    for name in NAMES:
        assert parse("--limit", f"{name}=7000000") == Limits(**{name: 7_000_000})
    assert parse() == Limits()
    assert parse("--limit", "rows=1", "--limit", "rows=2", "--limit", "frames=3") == Limits(
        rows=2, frames=3
    )


WRONG = {
    "--limit rows=0": "the limit rows is '0'",
    "--cache-time 0": "--cache-time: '0' is not a duration above 0 s",
    "--cache-time 10": "--cache-time: '10' is ambiguous: 10 seconds or",
    "--workers 0": "--workers: '0' is not a whole number",
    f"--tree {'x' * 256}": "--tree",
    "--listen tcp/[::]:1 --connect tcp/[::]:1": "exclude each other",
    "--mirror-of tcp/h:1": "is not NAME=PROTOCOL/HOST:PORT/TREE",
    "--mirror-of a/b=tcp/h:1": "a name has no '/'",
    "--mirror-of a=tcp/h": "is not NAME=PROTOCOL/HOST:PORT/TREE",
    "--mirror-of a=http/h:1": "unknown protocol",
    "--mirror-of a=tcp/h:1 --mirror-of a=tcp/h:2": "2 robots are called 'a'",
    "--mirror-shared map": "--mirror-shared needs --mirror-of",
    "--mirror-of a=tcp/h:1 --mirror-shared map,,world": "is not a list of frames",
    "--mirror-of a=tcp/h:1 --replica-of tcp/h:1": "exclude each other",
    **{
        f"--mirror-of {text}": text
        for text in ("robots/**", "ro*bots/*", "robots/*,speed=3", "robots/*,rate=x")
    },
    **{
        f"--mirror-of a=tcp/h:1{tree},{options}": message
        for tree in ("", "/main")
        for options, message in {
            "frames=map": "frames: 'map' is not a list of two or more frames",
            "frames=map::base": "frames: 'map::base' is not a list",
            "frames=": "frames: '' is not a list",
            "rate=fast": "rate: 'fast' is not a number",
            "rate=0": "rate: '0' is not a number of at least 0.001 and at most 1,000",
            "rate=1001": "rate: '1001' is not a number of at least 0.001 and at most 1,000",
            "max-frames=0": "max-frames: '0' is not a whole number",
            "rate=1,rate=2": "rate is given twice",
            "speed=2": "unknown option 'speed'",
        }.items()
    },
    "--ingest a": "'a' is not KEY=FORMAT, where FORMAT is one of lcm, foxglove",
    "--ingest a=avro": "is not KEY=FORMAT",
    "--ingest a//b=lcm": "'a//b' is no key expression of Zenoh",
    "--ingest **=lcm": "'**' matches this service's own keys, tf/v1/**",
    "--ingest a=lcm --users {users}": "carries no keys of other projects",
    "--ingest a=lcm --replica-of tcp/h:1": "give --ingest to the primary",
    "--ros2-prefix namespace": "--ros2-prefix needs --ros2",
    "--ros2 --ros2-prefix robot": "is not a rule",
    "--ros2 --ros2-shared map": "--ros2-shared needs --ros2-prefix",
    "--ros2 --ros2-prefix domain --ros2-shared a,,b": "is not a list of frames",
    "--ros2-publish --ros2-publish-rate 0": "is not a number of at least 0.1",
    "--ros2-publish --ros2-domain 300": "is not a whole number from 0 to 232",
    "--ros2 --ros2-static-grace=-1s": "'-1s' is not a duration of at least 0 s",
    "--ros2 --users {users}": "join the robots' router with --connect",
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_flags_are_explained(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str
) -> None:
    users = tmp_path / "users"
    users.write_text("nav:secret\n")
    users.chmod(0o600)
    assert WRONG[line] in error(capsys, *line.format(users=users).split())


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("row=1", "there is no limit 'row': did you mean rows?"),
        ("max-frames=1", "there is no limit 'max-frames': did you mean frames or "),
        ("samples-per-frame=1", "did you mean samples_per_frame"),
        ("depth=1", "there is no limit 'depth': it is fixed at 1,000"),
        ("zzzz=1", "there is no limit 'zzzz': --help lists all"),
        ("memory=1G", "the limit memory has a flag of its own, --max-memory"),
        ("rows", "'rows' is not NAME=VALUE"),
        ("rows=", "the limit rows is '': it must be a whole number from 1 to"),
        ("rows=1.5", "the limit rows is '1.5'"),
        ("rows=0", "the limit rows is '0': it must be a whole number from 1 to"),
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


def test_the_help_names_each_limit() -> None:
    (text,) = (group.description for group in flags.parser()._action_groups if group.description)
    assert text == f"NAME: {', '.join(NAMES)}."


def test_help_fits_on_two_screens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = flags.parser().format_help().splitlines()
    assert len(lines) <= 105
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
