"""The configuration file: every flag by its name, sections, access rules, and its errors."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import servers
from zenoh_tf._net import handover
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded
from zenoh_tf_server import config_file, flags
from zenoh_tf_server.limits import Limits


def parse(tmp_path: Path, text: str, *arguments: str) -> argparse.Namespace:
    path = tmp_path / "server.toml"
    path.write_text(text)
    return config_file.parse_arguments(flags.parser(), ["--config", str(path), *arguments])


def refused(tmp_path: Path, text: str, *arguments: str) -> str:
    with pytest.raises(InvalidArgumentException) as caught:
        parse(tmp_path, text, *arguments)
    assert "server.toml" in str(caught.value)
    return str(caught.value)


def test_flags_at_the_top_and_in_sections(tmp_path: Path) -> None:
    options = parse(
        tmp_path,
        """
        listen = ["tls/[::]:1", "tcp/127.0.0.1:2"]
        cache-time = "30s"
        one-authority-per-frame = true
        log-level = "debug"
        users = "people"
        tls-certificate = "server.pem"
        tls-ca = "/etc/ca.pem"
        [limits]
        rows = 1000
        samples_per_frame = 5
        [motion_limits.base_link]
        max_speed_m_s = 1
        [[access]]
        users = ["nav"]
        may = ["read"]
        """,
    )
    assert options.motion_limits == {"base_link": {"max_speed_m_s": 1}}
    assert options.listen == ["tls/[::]:1", "tcp/127.0.0.1:2"]
    assert (options.cache_time, type(options.cache_time)) == (30.0, float)
    assert options.one_authority_per_frame is True
    assert options.log_level == "debug"
    assert dict(options.limit) == {"rows": 1000, "samples_per_frame": 5}
    assert options.tls_certificate == str(tmp_path / "server.pem")  # beside the file
    assert options.tls_ca == "/etc/ca.pem"
    assert options.users == str(tmp_path / "people")
    assert [(rule.users, rule.may) for rule in options.access] == [(("nav",), {"read"})]
    assert options.tree == "main"


def test_every_flag_can_stand_in_the_file(tmp_path: Path) -> None:
    without = {"help", "version", "config", "limit"}
    for action in flags.parser()._actions:
        name = action.option_strings[-1].removeprefix("--")
        if name in without:
            continue
        value: object = "true"
        if action.nargs != 0:
            is_number = type(action.default) in (int, float)
            number = '"3s"' if action.metavar == "DURATION" else 3
            value = (
                number if is_number else repr(next(iter(action.choices)) if action.choices else "x")
            )
        try:
            options = parse(tmp_path, f"{name} = {value}")
        except InvalidArgumentException as error:
            # A flag with a format of its own may refuse the value, but must know the name.
            assert "unknown key" not in str(error), name
            continue
        assert getattr(options, action.dest) != flags.parser().get_default(action.dest) or (
            action.choices
        ), name


def test_the_command_line_wins(tmp_path: Path) -> None:
    text = 'listen = ["tcp/127.0.0.1:1"]\ntree = "a"\n[limits]\nrows = 7\nframes = 8\n'
    options = parse(tmp_path, text, "--limit", "rows=100000", "--tree", "main")
    # Both values are the defaults, but they were given.
    assert (dict(options.limit), options.tree) == ({"rows": 100_000, "frames": 8}, "main")
    assert parse(tmp_path, text, "--listen", "tcp/[::1]:9").listen == ["tcp/[::1]:9"]
    options = parse(tmp_path, text, "--connect", "tcp/[::1]:9")
    assert (options.listen, options.connect) == ([], ["tcp/[::1]:9"])


@pytest.mark.parametrize("value", ['"1G"', "1073741824"])
def test_a_value_is_read_as_on_the_command_line(tmp_path: Path, value: str) -> None:
    assert parse(tmp_path, f"max-memory = {value}").max_memory == 1 << 30


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("max-memory = '1X'", "max-memory: '1X' is not a number of bytes"),
        ("[limits]\nmemory = '1G'", "memory has a flag of its own, --max-memory"),
        ("[limits]\ntree = 'a'", "there is no limit 'tree'"),
        ("[limit]\nrows = 1", "unknown key 'limit': did you mean 'limits'?"),
        ("limit = ['rows=1']", "unknown key 'limit': did you mean 'limits'?"),
        ("limits = 5", "write limits in a table [limits]"),
        ("cach-time = 1", "unknown key 'cach-time': did you mean 'cache-time'?"),
        ('tls-certificat = "a"', "did you mean 'tls-certificate'?"),
        ('[tls]\ncertificate = "a"', "unknown key 'tls'"),
        ("[[acces]]\nmay = []", "unknown key 'acces': did you mean 'access'?"),
        ("qqqq = 1", "unknown key 'qqqq': --help lists all"),
        ('config = "x"', "unknown key 'config'"),
        ("[limits]\nrows = '5x'", "the limit rows is '5x': it must be a whole number from 1 to"),
        ("[limits]\nrows = true", "rows must be a text or a number, not True"),
        pytest.param("a = " + "[" * 100_000, "is nested too deeply", id="deep array"),
        pytest.param("a = " + "{a=" * 50_000, "is nested too deeply", id="deep table"),
        ("workers = 100000", "workers: '100000' is not a whole number from 1 to 256"),
        ("workers = true", "workers must be a text or a number, not True"),
        ("cache-time = 30", "cache-time: '30' is ambiguous: 30 seconds or 30 milliseconds"),
        ("tree = []", "tree must be a text or a number"),
        ("no-admin = 1", "no-admin must be true or false"),
        ("listen = [[]]", "listen must be a text"),
        ("log-level = 'loud'", "log-level: invalid choice: 'loud' (choose from 'debug'"),
        ("a = = 1", "is not TOML"),
        ("motion_limits = 1", "write limits of motion in tables [motion_limits.FRAME]"),
        ("motion-limits = 1", "did you mean 'motion_limits'?"),
        ("[motion_limits]\nbase = 1.0", "motion_limits.base must be a table such as"),
        ("[motion_limits.base]\nmax_sped_m_s = 1", "did you mean 'max_speed_m_s'?"),
        ("[motion_limits.base]\nmass = 1", "unknown key 'motion_limits.base.mass': use max_speed"),
        ("[motion_limits.a]\nmax_speed_m_s = -1", "motion_limits.a.max_speed_m_s must be a number"),
        ("[motion_limits.a]\nmax_speed_m_s = nan", "must be a number, 0 or more, not nan"),
        ("[motion_limits.a]\nmax_speed_m_s = '1'", "must be a number, 0 or more, not '1'"),
        ("[motion_limits.a]\nmax_speed_m_s = true", "must be a number, 0 or more, not True"),
        ("[motion_limits.a]\nmax_speed_m_s = 1" + 309 * "0", "max_speed_m_s must be 0 or more"),
        ("[motion_limits.a]\nmax_clock_error_s = 1" + 400 * "0", "must be 0 or more, not 10000"),
        ("[motion_limits.'']\nmax_speed_m_s = 1", "[motion_limits.]: "),
        ("[access]\nmay = ['read']", "write access rules as tables [[access]]"),
        ("[[access]]\nmy = ['read']", "access rule 1 has the unknown key 'my'"),
        ("[[access]]\nmay = ['read']\n[[access]]\nmay = ['x']", "access rule 2: there is no"),
        ("[[access]]\nusers = []\nmay = ['read']", "access rule 1: users is empty"),
        ("[[access]]\npublish = 'wheels'", "publish must be a list of texts"),
        ("[[access]]\npublish = ['a*b']", "a '*' is allowed at the end only"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refused(tmp_path, text)


def test_a_missing_file() -> None:
    with pytest.raises(InvalidArgumentException, match=r"cannot read /nowhere/x\.toml"):
        config_file.parse_arguments(flags.parser(), ["--config", "/nowhere/x.toml"])


def test_the_program_reads_it(tmp_path: Path, start_server: StartServer) -> None:
    path = tmp_path / "server.toml"
    path.write_text("[limits]\nrows = 3\n")
    server = start_server("--config", str(path))
    with server.connect() as tf:
        with pytest.raises(LimitExceeded) as caught:
            tf.lookup_transforms("a", "b", [1, 2, 3, 4])
        assert caught.value.limit == 3
    path.write_text("[limits]\nrow = 3\n")
    assert servers.refused("--config", str(path)).endswith("did you mean rows?")


def test_limits_of_motion_have_room_in_one_message(tmp_path: Path) -> None:
    def text(count: int) -> str:
        frames = "".join(f'"{i:0>255}".max_speed_m_s = 1.0\n' for i in range(count))
        return f"[motion_limits]\n{frames}"

    limits = parse(tmp_path, text(200)).motion_limits
    columns = {child: (1.0, 1.0, 1.0, 1.0, 1.0) for child in limits}
    assert len(handover.message("main", "one", Limits().as_dict(), columns)) < 1 << 16
    assert "motion_limits must be of 200 frames at most" in refused(tmp_path, text(201))
