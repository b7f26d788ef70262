"""The wire protocol, version 1: msgpack maps with columns. No I/O; both sides use it.

`fields` has bytes and typed fields, `faults` the errors, `lookup` reads, `commit` writes,
`calls` batches and everything else. docs/protocol.md describes it for other languages.
"""

from .calls import batch_body, call_body, parse_batch, parse_batch_reply, parse_value
from .commit import (
    Commit,
    Write,
    commit_body,
    commit_reply,
    parse_commit,
    parse_commit_reply,
    parse_write,
)
from .faults import as_transform_exception, error_reply, fault, parse_fault, raise_error
from .fields import MAX_MESSAGE_BYTES, VERSION, Message, flag, integer, pack, text, unpack
from .lookup import (
    NO_STAMP,
    OP_AT,
    OP_COMMON,
    OP_COMMON_TIME,
    OP_FULL,
    OP_LATEST,
    OP_LATEST_XACT,
    Lookup,
    LookupReply,
    lookup_body,
    lookup_reply,
    one_read,
    parse_lookup,
    parse_lookup_reply,
    parse_read_set,
)

__all__ = [
    "MAX_MESSAGE_BYTES",
    "NO_STAMP",
    "OP_AT",
    "OP_COMMON",
    "OP_COMMON_TIME",
    "OP_FULL",
    "OP_LATEST",
    "OP_LATEST_XACT",
    "VERSION",
    "Commit",
    "Lookup",
    "LookupReply",
    "Message",
    "Write",
    "as_transform_exception",
    "batch_body",
    "call_body",
    "commit_body",
    "commit_reply",
    "error_reply",
    "fault",
    "flag",
    "integer",
    "lookup_body",
    "lookup_reply",
    "one_read",
    "pack",
    "parse_batch",
    "parse_batch_reply",
    "parse_commit",
    "parse_commit_reply",
    "parse_fault",
    "parse_lookup",
    "parse_lookup_reply",
    "parse_read_set",
    "parse_value",
    "parse_write",
    "raise_error",
    "text",
    "unpack",
]
