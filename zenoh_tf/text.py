"""Text of others, made safe for a log line or a terminal: escaped and cut."""

from __future__ import annotations

import re
from typing import Final

#: Characters of a name that a message shows.
MAX_NAME: Final = 80

#: Control characters and what else ends a line or turns its direction.
_UNSAFE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def escaped(text: str, limit: int) -> str:
    """Return `text` in one printable line of about `limit` characters at most.

    Args:
        text: Any text; what follows the limit is cut, and how much it was is said.
        limit: Characters of `text` to keep.
    """
    kept = _UNSAFE.sub(_escape, text[:limit])
    return kept if len(text) <= limit else f"{kept}... ({len(text) - limit:,} more characters)"


def quoted(name: str) -> str:
    """Return a name in quotes, escaped and cut to MAX_NAME characters.

    Args:
        name: Any name, for instance of a frame or of an authority.
    """
    return f"'{escaped(name, MAX_NAME)}'"


def _escape(match: re.Match[str]) -> str:
    return match.group().encode("unicode_escape", "surrogatepass").decode("ascii")
