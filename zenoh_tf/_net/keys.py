"""Zenoh key expressions of the service, and names made safe for them.

    tf/v1/{tree}/lookup            query   many lookups
    tf/v1/{tree}/commit            query   one write transaction
    tf/v1/{tree}/batch             query   an ordered list of lookups, commits and infos
    tf/v1/{tree}/info              query   what the tree holds
    tf/v1/{tree}/admin             query   clear, reset, remove_frame
    tf/v1/{tree}/hello             query   the server's id, limits and clock; the client's rights
    tf/v1/{tree}/snapshot          query   all frames and histories, in pieces
    tf/v1/{tree}/missed            query   messages of the stream that were missed
    tf/v1/{tree}/commit/{authority}   query   the same as above; writes of a server that has
    tf/v1/{tree}/batch/{authority}    query   access rules, which work on keys
    tf/v1/{tree}/admin/{what}         query
    tf/v1/{tree}/set/{authority}      put  transforms from a sensor
    tf/v1/{tree}/static/{authority}   put  static transforms from a sensor
    tf/v1/{tree}/stream/{instance}    put  what commits change, from the server
    tf/v1/{tree}/stream/{instance}/{interest}   put   the same of an interest (`wire.Interest`)
    tf/v1/{tree}/server/{instance}    liveliness token of the server
    tf/v1/{tree}/client/{client}      liveliness token of a client

Tree and authority names may be any UTF-8 text. They are percent-escaped, so that each fills
exactly one chunk of the key. Frame names are never part of a key: they travel in payloads.
"""

from __future__ import annotations

import re
from typing import Final

from ..errors import InvalidArgumentException
from ..text import quoted

PREFIX: Final = "tf/v1"
#: The types of requests, in the order of docs/reference/protocol.md.
REQUEST_TYPES: Final = (
    "lookup",
    "commit",
    "batch",
    "info",
    "admin",
    "hello",
    "snapshot",
    "missed",
)

#: Follows the client's id in a query's attachment: the client joins a reply that comes in parts.
TAKES_PARTS: Final = "parts"

#: Longest name in UTF-8 bytes. Escaping may triple it, and Zenoh's keys should be short.
MAX_NAME_BYTES: Final = 255

#: The chunk of the empty name. No other name is escaped to a lone '%'.
_EMPTY: Final = "%"

#: Zenoh reserves / * $ ? #, a leading '@' hides a chunk from wildcards, and '%' is the escape
#: character. Zenoh allows control characters, but they would garble logs and terminals.
_UNSAFE = re.compile(r"[/*$?#%@\x00-\x20\x7f-\x9f\u2028\u2029]")
_ESCAPED = re.compile(r"(?:%[0-9A-F]{2})+")


def escape(name: str, what: str = "name") -> str:
    """The key chunk of a name; `unescape` returns the name.

    Raises:
        InvalidArgumentException: The name is not valid UTF-8 (lone surrogates) or longer than
            MAX_NAME_BYTES; `field` is `what`.
    """
    try:
        size = len(name.encode())
    except UnicodeEncodeError as error:
        raise InvalidArgumentException(f"{what} is not valid UTF-8", field=what) from error
    if size > MAX_NAME_BYTES:
        raise InvalidArgumentException(
            f"{what} has {size} bytes of UTF-8: the limit is {MAX_NAME_BYTES}; shorten the name",
            field=what,
            limit=MAX_NAME_BYTES,
            value=size,
        )
    return _UNSAFE.sub(_percent, name) if name else _EMPTY


def unescape(chunk: str) -> str:
    """The name of a key chunk.

    Each name has exactly one spelling as a chunk, so no other spelling can evade access rules
    on keys.

    Raises:
        InvalidArgumentException: `escape` never returns this chunk; `field` is "chunk".
    """
    if chunk == _EMPTY:
        return ""
    try:
        name = _ESCAPED.sub(_unpercent, chunk)
        canonical = escape(name) == chunk
    except (UnicodeDecodeError, InvalidArgumentException):
        canonical = False
    if not canonical:
        raise InvalidArgumentException(
            f"key chunk {quoted(chunk)} is no escaped name: see docs/reference/protocol.md",
            field="chunk",
        )
    return name


def _percent(match: re.Match[str]) -> str:
    return "".join(f"%{byte:02X}" for byte in match.group().encode())


def _unpercent(match: re.Match[str]) -> str:
    return bytes.fromhex(match.group().replace("%", "")).decode()


def request(tree: str, request_type: str) -> str:
    """The key of a type of request, e.g. ``request("main", "lookup")``."""
    if request_type not in REQUEST_TYPES:
        raise InvalidArgumentException(
            f"unknown request type {quoted(request_type)}: use one of {', '.join(REQUEST_TYPES)}",
            field="request_type",
        )
    return f"{prefix(tree)}/{request_type}"


def write_request(tree: str, request_type: str, subject: str) -> str:
    """The key of a write for access rules: it names the authority, or the admin call."""
    return f"{request(tree, request_type)}/{escape(subject, 'authority')}"


def subject(key: str) -> str | None:
    """What stands behind the request type in a query's key, as a chunk; None if nothing does, or
    more than one chunk."""
    chunks = key.removeprefix(f"{PREFIX}/").split("/")
    return chunks[2] if len(chunks) == 3 else None


def prefix(tree: str) -> str:
    """What all keys of a tree begin with, without the slash after it."""
    return f"{PREFIX}/{escape(tree, 'tree')}"


def put(tree: str, authority: str, *, static: bool) -> str:
    """The key on which `authority` puts transforms."""
    kind = "static" if static else "set"
    return f"{prefix(tree)}/{kind}/{escape(authority, 'authority')}"


def all_puts(tree: str) -> str:
    """A key expression of all puts of a tree, static and not, and of other keys (`put_kind`)."""
    return f"{prefix(tree)}/*/*"


def put_kind(key: str) -> str | None:
    """``set`` or ``static`` of a put's key; None for any other key of a tree."""
    kind = key.rpartition("/")[0].rpartition("/")[2]
    return kind if kind in ("set", "static") else None


def stream(tree: str, instance: str, interest: str = "") -> str:
    """The key on which a server instance publishes what commits change, or of an interest's id."""
    key = f"{prefix(tree)}/stream/{escape(instance, 'instance')}"
    return f"{key}/{interest}" if interest else key


def streams(tree: str, interest: str = "") -> str:
    """The key expression of the streams of a tree's servers, one after another; "*": of all
    interests."""
    key = f"{prefix(tree)}/stream/*"
    return f"{key}/{interest}" if interest else key


def streams_of_trees(before: str, after: str, interest: str = "") -> str:
    """The key expression of `streams` of all trees whose names begin with `before` and end with
    `after`."""
    ends = [_UNSAFE.sub(_percent, part) for part in (before, after)]
    key = f"{PREFIX}/{'$*'.join(ends) if any(ends) else '*'}/stream/*"
    return f"{key}/{interest}" if interest else key


def server(tree: str, instance: str) -> str:
    """The key of a server's liveliness token."""
    return f"{prefix(tree)}/server/{escape(instance, 'instance')}"


def servers(tree: str) -> str:
    """The key expression of every server's liveliness token."""
    return f"{prefix(tree)}/server/*"


def candidate(tree: str, instance: str) -> str:
    """The key of the liveliness token of a server that is about to serve a tree."""
    return f"{prefix(tree)}/candidate/{escape(instance, 'instance')}"


def candidates(tree: str) -> str:
    """The key expression of every candidate's liveliness token."""
    return f"{prefix(tree)}/candidate/*"


def all_servers() -> str:
    """The key expression of the liveliness tokens of all trees' servers."""
    return f"{PREFIX}/*/server/*"


def client(tree: str, client_id: str) -> str:
    """The key of a client's liveliness token."""
    return f"{prefix(tree)}/client/{escape(client_id, 'client')}"


def clients(tree: str) -> str:
    """The key expression of every client's liveliness token."""
    return f"{prefix(tree)}/client/*"


def tree_name(key: str) -> str:
    """The tree of any key of the service."""
    return unescape(tree_chunk(key))


def tree_chunk(key: str) -> str:
    """The tree of any key of the service, escaped."""
    return key.removeprefix(f"{PREFIX}/").partition("/")[0]


def last_name(key: str) -> str:
    """The authority of a put's key, or the instance or client of a liveliness token's key."""
    return unescape(key.rpartition("/")[2])
