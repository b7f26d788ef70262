"""Text that others have chosen, made safe to show: nothing raw, nothing long.

Anyone may name a frame or send a field. A terminal executes control characters, a log is split by
line ends, and bidirectional controls reorder what a reader sees. `quoted` is for a name or a value
in a message, `printable` for a whole line, `cut` for the length alone.
"""

from __future__ import annotations

import reprlib
from typing import Final

#: Characters of a name or a value that a message quotes.
QUOTED_CHARS: Final = 100


def printable(text: str) -> str:
    r"""Return `text` with every character that is not printable escaped, such as ``\n``.

    Escaped are the control characters (C0, DEL, C1), the line and paragraph separators, all
    format characters (among them the bidirectional controls) and lone surrogates.
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


def cut(text: str, limit: int) -> str:
    """Return `text` if it has at most `limit` characters, else its beginning and its length.

    The result has at most `limit` characters, 40 or more, so it is not cut again.
    """
    if len(text) <= limit:
        return text
    end = f"... ({len(text):,} characters)"
    return text[: limit - len(end)] + end


def quoted(value: object, limit: int = QUOTED_CHARS) -> str:
    """Return a name, or a received value of any type and size, as a message shows it: in quotes,
    escaped and cut."""
    if not isinstance(value, str):
        return _SHORT.repr(value)
    if len(value) <= limit:
        return repr(value)
    return f"{value[:limit]!r}... ({len(value):,} characters)"


class _Short(reprlib.Repr):
    """The `repr` of a value, computed in bounded time: the value may be a whole message."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 2
        self.maxlist = self.maxdict = 3
        self.maxstring = 40

    def repr_bytes(self, value: bytes, level: int) -> str:
        return f"<{len(value):,} bytes>"


_SHORT: Final = _Short()
