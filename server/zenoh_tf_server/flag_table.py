"""The server's flags, each declared once: as a field of a class of settings.

From these fields come the flags of the command line and with them the keys of the configuration
file, the help, and docs/reference/server.md (`add`), and the settings that they say (`read`).
"""

from __future__ import annotations

import argparse
from dataclasses import Field, field, fields, is_dataclass
from typing import Any, TypeVar

Settings = TypeVar("Settings")


def flag(name: str, default: object, help: str, *, group: str, **options: Any) -> Any:
    """A field that a flag sets. `options`: more of what argparse's `add_argument` takes.

    One without a `metavar` has no value, and is `default` negated if it is given. One with an
    `action` "append" is repeatable, and a tuple.
    """
    if "metavar" not in options:
        options["action"] = "store_true"
    added = {"default": default, "help": help} | options
    if added.get("action") == "append":
        added["default"] = []
    return field(default=default, metadata={"flag": name, "group": group, "added": added})


def add(parser: argparse.ArgumentParser, settings: type) -> None:
    """Add the flags of a class of settings, and of those that are its fields, in groups."""
    groups = {group.title: group for group in parser._action_groups}
    for entry in fields(settings):
        if (nested := _nested(entry)) is not None:
            add(parser, nested)
            groups = {group.title: group for group in parser._action_groups}
        elif "flag" in entry.metadata:
            title = entry.metadata["group"]
            if title not in groups:
                groups[title] = parser.add_argument_group(title)
            groups[title].add_argument(entry.metadata["flag"], **entry.metadata["added"])


def read(settings: type[Settings], options: argparse.Namespace, **others: Any) -> Settings:
    """The settings that the flags say. `others`: fields that no flag sets."""
    values = dict(others)
    for entry in fields(settings):  # type: ignore[arg-type]
        if entry.name in values:
            continue
        if (nested := _nested(entry)) is not None:
            values[entry.name] = read(nested, options)
        elif "flag" in entry.metadata:
            value = getattr(options, entry.metadata["flag"].lstrip("-").replace("-", "_"))
            values[entry.name] = tuple(value) if isinstance(value, list) else value
    return settings(**values)


def _nested(entry: Field[Any]) -> type | None:
    """The class of settings that a field is of."""
    made = entry.default_factory
    return made if isinstance(made, type) and is_dataclass(made) else None
