"""The server's configuration file: its flags by name in TOML, the limits, the access rules, and
limits of motion.

    cache-time = "30s"
    listen = ["tls/0.0.0.0:7447"]
    tls-certificate = "server.pem"  # --tls-certificate

    [limits]
    rows = 1000                     # --limit rows=1000

    [motion_limits.base_link]
    max_speed_m_s = 1.0

    [[access]]
    users = ["nav"]
    may = ["read"]

Each key becomes a flag, which the command line's parser reads, so types and ranges are those of the
flags. Paths are relative to the file's folder. Flags of the command line win.
"""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from zenoh_tf.errors import InvalidArgumentException, must_be
from zenoh_tf.text import toml
from zenoh_tf.text.flag_values import file_path

from . import motion_limits
from .security import access_rules

#: Sections of the file that are no flags.
_ACCESS: Final = "access"
_LIMITS: Final = "limits"
_MOTION: Final = motion_limits.SECTION
#: Flags that cannot be in a file, where limits have a section.
_NOT_IN_FILE: Final = ("help", "version", "config", "limit")
#: The types of flags that are paths.
_PATHS: Final = (Path, file_path)


def parse_arguments(
    parser: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """The flags of a command line, completed from the file that ``--config`` names. The access
    rules are in `access`, the limits of motion in `motion_limits`.

    Raises:
        InvalidArgumentException: The file is wrong; the message names the key.
    """
    options = parser.parse_args(arguments)
    if options.config is None:
        options.access, options.motion_limits = (), {}
        return options
    given = read(parser, Path(options.config))
    where = [] if not (options.listen or options.connect) else ["listen", "connect"]
    repeated = [
        action.dest
        for action in parser._actions
        if isinstance(action, argparse._AppendAction) and getattr(options, action.dest)
    ]
    for dest in {*where, *repeated} - {"limit"}:
        setattr(given, dest, [])  # those of the command line replace the file's
    return parser.parse_args(arguments, given)


def read(parser: argparse.ArgumentParser, path: Path) -> argparse.Namespace:
    """The flags in a file, the limits of motion and the access rules.

    Raises:
        InvalidArgumentException: The file is wrong.
    """
    try:
        with path.open("rb") as file:
            document = toml.loads(file.read().decode())
    except OSError as error:
        raise InvalidArgumentException(f"cannot read {path}: {error.strerror}") from error
    except toml.NoReader as error:
        raise InvalidArgumentException(f"cannot read {path}: {error}") from error
    except ValueError as error:
        raise InvalidArgumentException(f"{path} is not TOML: {error}") from error
    except RecursionError:
        raise InvalidArgumentException(f"{path} is nested too deeply") from None
    try:
        rules = access_rules.parse(document.pop(_ACCESS, []))
        motion = motion_limits.parse(document.pop(_MOTION, {}))
        limits = document.pop(_LIMITS, {})
        if not isinstance(limits, dict):
            raise InvalidArgumentException("write limits in a table [limits]")
        flags = [f"--limit={name}={_text(name, value)}" for name, value in limits.items()]
        flags += _flags(parser, document, path.parent)
        options = parser.parse_args(flags)
    except argparse.ArgumentError as error:
        name = (error.argument_name or "").removeprefix("--")
        raise InvalidArgumentException(f"{path}: {name}: {error.message}", field=name) from error
    except InvalidArgumentException as error:
        raise InvalidArgumentException(f"{path}: {error}", field="config") from error
    options.access, options.motion_limits = rules, motion
    return options


def _flags(
    parser: argparse.ArgumentParser, document: dict[str, Any], folder: Path
) -> Iterator[str]:
    """The flags of a file as a command line has them."""
    actions = {
        option.removeprefix("--"): action
        for action in parser._actions
        for option in action.option_strings
        if option.startswith("--") and option.removeprefix("--") not in _NOT_IN_FILE
    }
    for name, value in document.items():
        action = actions.get(name)
        if action is None:
            nearest = difflib.get_close_matches(name, [*actions, _ACCESS, _LIMITS, _MOTION], 1)
            hint = f": did you mean {nearest[0]!r}?" if nearest else ": --help lists all"
            raise InvalidArgumentException(f"unknown key {name!r}{hint}", field=name)
        if action.nargs == 0:
            if not isinstance(value, bool):
                raise must_be(name, "true or false", value)
            if value:
                yield f"--{name}"
            continue
        repeats = isinstance(action, argparse._AppendAction) and isinstance(value, list)
        for text in [_text(name, each) for each in (value if repeats else [value])]:
            yield f"--{name}={folder / text if action.type in _PATHS else text}"


def _text(name: str, value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise must_be(name, "a text or a number", value)
    return str(value)
