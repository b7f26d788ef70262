"""The file of a server's state: an SQLite database in WAL mode, and a lock on its folder.

A write is one transaction, so that a kill or a power cut leaves all of it or nothing. A new
database gets its final name only once it is complete: a file that is not whole was damaged, and
never comes from a server that was killed.

Every row has a checksum, because SQLite has none: a bit that the disk has changed is an error, and
no other value. Only the file's owner may read or write it.

Thread safety: none; one thread at a time.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import sqlite3
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import msgpack

SCHEMA_VERSION: Final = 4
#: Distinguishes the file from other SQLite databases ("ztfs").
_APPLICATION_ID: Final = 0x7A746673
_NAME: Final = "state.sqlite3"
_LOCK_NAME: Final = "lock"
#: `value` is msgpack: a `StoredLink`, or the number of a removal; nil for the tree's name.
_CREATE: Final = (
    "CREATE TABLE entries (section TEXT NOT NULL, name TEXT NOT NULL, value BLOB NOT NULL, "
    "checksum INTEGER NOT NULL, PRIMARY KEY (section, name), "
    "CHECK (section IN ('served', 'static_links', 'removed_links')))"
)
_INSERT: Final = "INSERT OR REPLACE INTO entries VALUES (?, ?, ?, ?)"
#: The section with the name of the tree.
_SERVED: Final = "served"

#: SQLite's codes for a file that is damaged, is none of its own, or has other tables.
_CORRUPT: Final = 11
_DAMAGE: Final = (_CORRUPT, 26, 1)
#: How its messages of other errors begin. On Python 3.10 an error has no code.
_NO_DAMAGE: Final = (
    "attempt to write a readonly database",
    "database is locked",
    "database or disk is full",
    "disk I/O error",
    "unable to open database file",
)

Sync = Literal["full", "normal"]


class StateError(Exception):
    """The state cannot be opened or restored; the message is one line for the user."""


class Table(Enum):
    """The sections of what is stored, each by the name of its child frame."""

    STATIC_LINKS = "static_links"
    #: Static links that were removed: the number grows with each removal.
    REMOVED_LINKS = "removed_links"


class StoredLink(NamedTuple):
    """A transform without the name of its child frame, and its publisher."""

    parent: str
    stamp_ns: int
    pose: tuple[float, ...]  # x y z qx qy qz qw of the child in the parent
    authority: str
    by_call: bool = False  # a call has set it, not a put


#: What is to be stored under (table, child): a link, the number of a removal, or None for nothing.
Changes = dict[tuple[Table, str], StoredLink | int | None]


@dataclass(slots=True)
class Stored:
    """All that a file holds."""

    static_links: dict[str, StoredLink] = field(default_factory=dict)
    removed_links: dict[str, int] = field(default_factory=dict)


class StateFile:
    """The open state of one tree. Holds the lock of its folder until `close`."""

    def __init__(self, folder: Path, tree: str, sync: Sync = "full") -> None:
        """Open the state in `folder`, or create both.

        Raises:
            StateError: Another server uses the folder, it cannot be written, or its file is
                damaged, of another tree or of a newer version.
        """
        self.path = folder / _NAME
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._lock = _lock(folder)
        except OSError as error:
            raise StateError(f"cannot use --state-dir {folder}: {error}") from error
        try:
            # A link to a file that is missing, as of a disk that is not mounted, is no new state.
            if not self.path.exists():
                if self.path.is_symlink():
                    raise self._damaged(f"it is a link to {self.path.readlink()}, which is missing")
                self._create(tree)
            self._database = self._open(sync)
            try:
                self._check(tree)
            except BaseException:
                self._database.close()
                raise
        except BaseException as error:
            os.close(self._lock)
            if isinstance(error, (sqlite3.Error, UnicodeError)):
                raise self._unusable(error) from error
            raise

    def read(self) -> Stored:
        """Everything that is stored.

        Raises:
            StateError: A row is damaged.
        """
        try:
            entries = self._entries(Table.STATIC_LINKS.value)
            links = {name: StoredLink(*fields) for name, fields in entries}
            removed = sorted(self._entries(Table.REMOVED_LINKS.value), key=itemgetter(1))
            return Stored(links, dict(removed))
        except (sqlite3.Error, UnicodeError) as error:
            raise self._unusable(error) from error

    def write(self, changes: Changes) -> None:
        """Store all changes in one transaction; it is durable on return.

        Raises:
            sqlite3.Error: Nothing was stored, because of the disk for instance.
        """
        execute = self._database.execute
        execute("BEGIN IMMEDIATE")
        try:
            for (table, child), value in changes.items():
                if value is not None:
                    execute(_INSERT, _row(table.value, child, value))
                else:
                    key = table.value, child
                    execute("DELETE FROM entries WHERE section = ? AND name = ?", key)
            execute("COMMIT")
        except BaseException:
            # SQLite has rolled back by itself after some errors, such as a full disk.
            with contextlib.suppress(sqlite3.Error):
                execute("ROLLBACK")
            raise

    def close(self) -> None:
        """Close the file and let go of the folder."""
        try:
            with contextlib.suppress(sqlite3.Error):  # what was written is durable already
                self._database.close()
        finally:
            os.close(self._lock)

    def _create(self, tree: str) -> None:
        if any(Path(f"{self.path}{suffix}").exists() for suffix in ("-wal", "-journal")):
            raise self._damaged("the file is missing, and its log is there")
        draft = self.path.with_name(_NAME + ".new")
        for path in (draft, *(Path(f"{draft}{suffix}") for suffix in ("-wal", "-journal"))):
            path.unlink(missing_ok=True)  # of a server that was killed at its first start
        try:
            # SQLite gives the files beside it the same mode.
            os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
            with contextlib.closing(sqlite3.connect(draft, isolation_level=None)) as database:
                database.execute("PRAGMA synchronous = FULL")
                database.execute("BEGIN IMMEDIATE")
                database.execute(_CREATE)
                database.execute(_INSERT, _row(_SERVED, tree, None))
                database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
                database.execute("COMMIT")
            os.replace(draft, self.path)
            _sync_folder(self.path.parent)
        except (OSError, sqlite3.Error) as error:
            raise StateError(f"cannot create the state {self.path}: {error}") from error

    def _open(self, sync: Sync) -> sqlite3.Connection:
        database = sqlite3.connect(
            self.path,
            isolation_level=None,
            timeout=0,
            check_same_thread=False,  # opened by the main thread, written by another
        )
        try:
            # Exclusive: no shared memory beside the file, and no other program writes to it.
            database.execute("PRAGMA locking_mode = EXCLUSIVE")
            database.execute("PRAGMA journal_mode = WAL")
            database.execute(f"PRAGMA synchronous = {sync.upper()}")
        except BaseException:
            database.close()
            raise
        return database

    def _check(self, tree: str) -> None:
        if self._number("PRAGMA application_id") != _APPLICATION_ID:
            raise self._damaged("it is not a state of zenoh-tf-server")
        version = self._number("PRAGMA user_version")
        if version != SCHEMA_VERSION:
            raise StateError(
                f"the state {self.path} has version {version}, and this server knows version "
                f"{SCHEMA_VERSION}: start the server that wrote it, or choose another --state-dir"
            )
        # Not the quick check: a row that is in the table or in its index alone would be lost.
        faults = [row[0] for row in self._database.execute("PRAGMA integrity_check(1)")]
        if faults != ["ok"]:
            raise self._damaged("; ".join(faults))
        served = [name for name, _ in self._entries(_SERVED)]
        if len(served) != 1:
            raise self._damaged("it does not have the tree's name")
        if served[0] != tree:
            raise StateError(
                f"the state {self.path} belongs to tree {served[0]!r}, not to {tree!r}: "
                "give each tree a --state-dir of its own"
            )

    def _number(self, statement: str) -> int:
        number: int = self._database.execute(statement).fetchone()[0]
        return number

    def _entries(self, section: str) -> Iterator[tuple[str, Any]]:
        """The names and values of a section, whose checksums are compared."""
        rows = self._database.execute(
            "SELECT name, value, checksum FROM entries WHERE section = ? ORDER BY name", (section,)
        )
        for name, value, checksum in rows:
            if (
                type(name) is not str
                or type(value) is not bytes
                or checksum != _checksum(section, name, value)
            ):
                raise self._damaged(f"the row of {name!r} in {section} has a wrong checksum")
            yield name, msgpack.unpackb(value, use_list=False)

    def _unusable(self, error: sqlite3.Error | UnicodeError) -> StateError:
        # Python's own errors, such as text that is not UTF-8, have no code.
        code = getattr(error, "sqlite_errorcode", _CORRUPT)
        # Without what extends the code.
        if code & 0xFF in _DAMAGE and not str(error).startswith(_NO_DAMAGE):
            return self._damaged(str(error))
        return StateError(f"cannot open the state {self.path}: {error}")

    def _damaged(self, reason: str) -> StateError:
        return StateError(
            f"the state {self.path} is damaged: {reason}; put back a copy of {self.path.parent}, "
            "or move it away to start without the links that were stored"
        )


def _row(section: str, name: str, value: object) -> tuple[str, str, bytes, int]:
    """A value as a row of the table."""
    data: bytes = msgpack.packb(value)
    return section, name, data, _checksum(section, name, data)


def _checksum(section: str, name: str, data: bytes) -> int:
    return zlib.crc32(f"{section}\0{name}\0".encode() + data)


def _lock(folder: Path) -> int:
    """Lock a folder until the returned descriptor is closed, or the process ends."""
    descriptor = os.open(folder / _LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        owner = os.read(descriptor, 32).decode("ascii", "replace").strip()
        os.close(descriptor)
        raise StateError(
            f"another server uses --state-dir {folder} (process {owner or 'unknown'}): "
            "stop it, or give each server a folder of its own"
        ) from error
    except BaseException:
        os.close(descriptor)
        raise
    with contextlib.suppress(OSError):  # only for the message above
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()}\n".encode())
    return descriptor


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
