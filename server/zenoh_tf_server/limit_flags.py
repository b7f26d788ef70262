"""``--limit NAME=VALUE`` and ``--max-memory``; the configuration file has the same names."""

from __future__ import annotations

import argparse
import difflib
import re
import shutil
import textwrap
from collections.abc import Iterator
from typing import Any, Final

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import size

from .limits import SETTABLE, Limits

#: The only limit with a flag of its own, which also accepts a unit.
_MEMORY: Final = "memory"
#: No client accepts a larger reply.
_HIGHEST: Final = {"reply_bytes": wire.MAX_REPLY_BYTES}
#: Any other limit must fit into the native module's numbers.
_HIGHEST_OF_ALL: Final = 10**15


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the limits."""
    group = parser.add_argument_group("limits")
    group.add_argument(
        "--max-memory",
        type=size(1 << 20),
        default=Limits().memory,
        metavar="BYTES",
        help="of all samples together, as in 512MB or 4G (default: 4G)",
    )
    group.add_argument(
        "--limit",
        action=_LimitAction,
        default={},
        metavar="NAME=VALUE",
        help="set a limit, as in frames=5000; repeatable; --limit help lists all",
    )


def from_flags(options: argparse.Namespace) -> Limits:
    """The limits that the flags of `add_flags` say."""
    return Limits(memory=options.max_memory, **options.limit)


def check(name: str, value: object) -> int:
    """Return `value`, which is to be that of the limit `name`.

    Raises:
        InvalidArgumentException: There is no such limit, or the value is wrong.
    """
    if name == _MEMORY:
        raise InvalidArgumentException(
            "the limit memory has a flag of its own, --max-memory (max-memory in the file)",
            field=name,
        )
    if name not in SETTABLE:
        nearest = difflib.get_close_matches(name.replace("-", "_"), SETTABLE, 3, 0.5)
        hint = f"did you mean {' or '.join(nearest)}?" if nearest else "--limit help lists all"
        if name in Limits.__slots__:
            hint = f"it is fixed at {getattr(Limits(), name):,}"
        raise InvalidArgumentException(f"there is no limit {quoted(name)}: {hint}", field=name)
    highest = _HIGHEST.get(name, _HIGHEST_OF_ALL)
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= highest:
        raise InvalidArgumentException(
            f"the limit {name} is {quoted(value)}: it must be a whole number from 1 to {highest:,}",
            field=name,
        )
    return value


def listing(width: int) -> Iterator[str]:
    """The lines of ``--limit help``: each limit with its default and meaning."""
    yield "--limit NAME=VALUE, or NAME = VALUE in [limits] of the file of --config."
    yield "What happens at each limit: docs/reference/limits.md."
    yield ""
    for name, default, meaning in [
        ("NAME", "DEFAULT", "LIMITS"),
        *((name, str(each.default), each.metadata["meaning"]) for name, each in SETTABLE.items()),
    ]:
        if name != _MEMORY:
            start = f"{name:<22}{default:>11}  "
            yield from textwrap.wrap(
                meaning, width, initial_indent=start, subsequent_indent=" " * len(start)
            )


class _LimitAction(argparse.Action):
    """Gathers ``NAME=VALUE`` in a dict. The value ``help`` prints the limits, and exits."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if values == "help":
            print("\n".join(listing(max(60, shutil.get_terminal_size().columns))))
            parser.exit()
        name, equals, text = values.partition("=")
        if not equals:
            raise argparse.ArgumentError(self, f"{quoted(values)} is not NAME=VALUE or help")
        # A text of more digits than any limit's value stays one, and is refused.
        value = int(text) if re.fullmatch("[0-9]{1,20}", text, re.ASCII) else text
        try:
            given = {name: check(name, value)}
        except InvalidArgumentException as error:
            raise argparse.ArgumentError(self, str(error)) from error
        setattr(namespace, self.dest, getattr(namespace, self.dest, {}) | given)
