"""The bytes of every message of the protocol, as they are stored, against the code of today.

`golden_v{N}.json` has those of version N. The code reads the stored messages of its own version and
of the one before, and gets from each what is stored beside it; those of its own version it also
writes, byte for byte. So nobody changes a message unseen, and version N speaks with N - 1.

When the protocol changes:

- A message or an optional field is new, which others ignore: add an example to `golden.py`, and run
  ``python -m tests.requests.golden``. No stored message changes, and a field that is not stored
  beside it is not compared.
- A test fails here because a message has changed: others, which are installed already, do not
  understand it. Either take the change back, or raise `wire.VERSION`, run the script, which writes
  the file of the new version, and keep the old one. The tests below then require that today's code
  reads the messages of the version before. What it cannot read gets an exception in the test, which
  names the message and the reason, and the page says so.
- The file of version N - 2 is deleted together with the code that reads it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from zenoh_tf import wire
from zenoh_tf._core import Changes, parse_single_answer
from zenoh_tf._net import keys
from zenoh_tf.wire.samples import ORPHANED

from . import golden, golden_records

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/protocol.md"
VERSIONS = [version for version in (wire.VERSION - 1, wire.VERSION) if version >= 1]
STORED = {version: golden.stored(version) for version in VERSIONS}


@pytest.mark.parametrize(
    ("version", "name"), [(version, name) for version in VERSIONS for name in STORED[version]]
)
def test_stored_messages_are_read(version: int, name: str) -> None:
    message = STORED[version][name]
    parse = golden.MESSAGES[name][1]
    read = golden.plain(parse(bytes.fromhex(message["bytes"])))
    assert _fields_of(message["read"], read) == message["read"]


def _fields_of(stored: Any, read: Any) -> Any:
    """What was read, without the fields that are not stored."""
    if isinstance(stored, dict) and isinstance(read, dict):
        return {key: _fields_of(stored[key], read[key]) for key in stored if key in read}
    if isinstance(stored, list) and isinstance(read, list) and len(stored) == len(read):
        return [_fields_of(*pair) for pair in zip(stored, read, strict=True)]
    return read


@pytest.mark.parametrize("name", golden.MESSAGES)
def test_messages_are_written_as_they_are_stored(name: str) -> None:
    """A message that is not stored is new: the script adds it."""
    assert golden.MESSAGES[name][0]().hex() == STORED[wire.VERSION][name]["bytes"]


def test_each_type_of_message_has_an_example() -> None:
    names = " ".join(golden.MESSAGES)
    for request_type in keys.REQUEST_TYPES:
        assert request_type in names
    kinds = Changes(golden.CHANGES).kind.tolist()
    assert set(kinds) == set(range(max(kinds) + 1)) and max(kinds) == ORPHANED


def test_the_native_client_reads_what_the_native_server_writes() -> None:
    data = bytes.fromhex(STORED[wire.VERSION]["reply to a lookup, by the native path"]["bytes"])
    found = parse_single_answer(data, golden_records.INSTANCE)
    assert found is not None and found[:2] == (7, 7)


def test_the_page_shows_stored_bytes() -> None:
    example = PAGE.read_text().partition("\n## Example\n")[2].partition("\n## ")[0]
    shown = ["".join(block.split()) for block in example.split("```")[1::2]]
    assert len(shown) == 3
    known = [message["bytes"] for message in STORED[wire.VERSION].values()]
    assert all(block.removeprefix("text") in known for block in shown)
