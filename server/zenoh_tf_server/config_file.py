"""The server's configuration file: its flags by name in TOML, the access rules, and limits of
motion.

    cache-time = "30s"
    listen = ["tls/0.0.0.0:7447"]
    users = "users.txt"             # --users

    [limits]
    rows = 1000                     # --limit rows=1000

    [tls]
    certificate = "server.pem"      # --tls-certificate

    [motion_limits.base_link]
    max_speed_m_s = 1.0

    [[access]]
    users = ["nav"]
    may = ["read"]

A flag may stand at the top or in any section, by its name; in `[NAME]` a `NAME-` may be left out.
`[limits]` has limits alone, and `[motion_limits]` those of links. Paths are relative to the file's
folder. Flags of the command line win.
"""

from __future__ import annotations

import argparse
import difflib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

from zenoh_tf.errors import InvalidArgumentException, must_be
from zenoh_tf.text.flag_values import file_path

from . import limit_flags, motion_limits
from .security import access_rules
from .security.access_rules import AccessRule

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
    options.access = ()
    options.motion_limits = {}
    if options.config is None:
        return options
    path = Path(options.config)
    given = read(parser, path)
    on_line = _given(parser, arguments)
    if "listen" in on_line or "connect" in on_line:
        given = {dest: value for dest, value in given.items() if dest not in ("listen", "connect")}
    options.limit = given.pop("limit") | options.limit
    for dest, value in given.items():
        if dest not in on_line:
            setattr(options, dest, value)
    if options.listen and options.connect:
        raise InvalidArgumentException(f"{path}: connect and listen exclude each other")
    return options


def _given(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The flags that the command line itself has: parsed once more, without defaults."""
    actions = _actions(parser).values()
    defaults = [(action, action.default) for action in actions]
    for action in actions:
        action.default = argparse.SUPPRESS
    try:
        return parser.parse_args(arguments)
    finally:
        for action, default in defaults:
            action.default = default


def read(parser: argparse.ArgumentParser, path: Path) -> dict[str, Any]:
    """The flags in a file, by `dest`, with the limits of motion and the access rules.

    Raises:
        InvalidArgumentException: The file is wrong.
    """
    try:
        with path.open("rb") as file:
            document = tomllib.load(file)
    except OSError as error:
        raise InvalidArgumentException(f"cannot read {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidArgumentException(f"{path} is not TOML: {error}") from error
    except RecursionError:
        raise InvalidArgumentException(f"{path} is nested too deeply") from None
    try:
        others = {
            "access": _rules(document.pop(_ACCESS, [])),
            "limit": _limits(document.pop(_LIMITS, {})),
            "motion_limits": motion_limits.parse(document.pop(_MOTION, {})),
        }
        return _flags(_actions(parser), document, path.parent) | others
    except InvalidArgumentException as error:
        raise InvalidArgumentException(f"{path}: {error}", field="config") from error


def _rules(tables: Any) -> tuple[AccessRule, ...]:
    if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
        raise InvalidArgumentException("write access rules as tables [[access]]")
    return access_rules.parse(tables)


def _limits(table: Any) -> dict[str, int]:
    if not isinstance(table, dict):
        raise InvalidArgumentException("write limits in a table [limits]")
    return {name: limit_flags.check(name, value) for name, value in table.items()}


def _actions(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Flag -> action, by the flag's long name without dashes."""
    return {
        option.removeprefix("--"): action
        for action in parser._actions
        for option in action.option_strings
        if option.startswith("--") and option.removeprefix("--") not in _NOT_IN_FILE
    }


def _flags(
    actions: dict[str, argparse.Action], document: dict[str, Any], folder: Path
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, key, value in _entries(document):
        flag = next((each for each in _spellings(name, key) if each in actions), None)
        if flag is None:
            _reject_unknown(name, key, actions)
        dest = actions[flag].dest
        if dest in found:
            raise InvalidArgumentException(f"{flag!r} is set twice", field=flag)
        found[dest] = _value(actions[flag], flag, value, folder)
    return found


def _entries(document: dict[str, Any]) -> list[tuple[str, str, Any]]:
    """All keys as (section, key, value); the section is empty at the top."""
    entries = []
    for name, value in document.items():
        if isinstance(value, dict):
            entries += [(name, key, inner) for key, inner in value.items()]
        else:
            entries.append(("", name, value))
    return entries


def _spellings(section: str, key: str) -> list[str]:
    """The flags that a key may stand for, the likeliest first."""
    key = key.replace("_", "-")
    if not section:
        return [key]
    return [f"{section}-{key}", key]


def _reject_unknown(section: str, key: str, actions: dict[str, argparse.Action]) -> NoReturn:
    shown = f"{section}.{key}" if section else key
    nearest = [
        close
        for spelling in _spellings(section, key)
        for close in difflib.get_close_matches(spelling, [*actions, _ACCESS, _LIMITS, _MOTION], 1)
    ]
    hint = f": did you mean {nearest[0]!r}?" if nearest else "; zenoh-tf-server --help lists all"
    raise InvalidArgumentException(f"unknown key {shown!r}{hint}", field=shown)


def _value(action: argparse.Action, flag: str, value: Any, folder: Path) -> Any:
    """A value of the file as the flag's own parser would return it: the type that the flag declares
    reads it as on the command line."""
    if action.nargs == 0:
        return _checked(flag, value, bool, "true or false")
    if isinstance(action, argparse._AppendAction) or action.nargs in ("+", "*"):
        values = value if isinstance(value, list) else [value]
        return [_single(action, flag, each, folder) for each in values]
    return _single(action, flag, value, folder)


def _single(action: argparse.Action, flag: str, value: Any, folder: Path) -> Any:
    if action.type is None:
        value = _checked(flag, value, str, "a text")
    else:
        assert callable(action.type)
        text = str(_checked(flag, value, (str, int, float), "a text or a number"))
        try:
            value = action.type(str(folder / text) if action.type in _PATHS else text)
        except (ValueError, TypeError, argparse.ArgumentTypeError) as error:
            raise InvalidArgumentException(f"{flag}: {error}", field=flag) from error
    if action.choices is not None and value not in action.choices:
        choices = ", ".join(map(str, action.choices))
        raise InvalidArgumentException(f"{flag} is {value!r}: use one of {choices}", field=flag)
    return value


def _checked(flag: str, value: Any, kind: type | tuple[type, ...], meaning: str) -> Any:
    is_number_for_bool = isinstance(value, bool) and kind is not bool
    if is_number_for_bool or not isinstance(value, kind):
        raise must_be(flag, meaning, value)
    return value
