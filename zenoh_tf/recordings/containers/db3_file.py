"""Reads db3 files of rosbag2, which are SQLite databases, with Python's own library.

Their messages have no checksum. A row whose columns have other types is left out, and what can be
read before and behind a damaged page is read.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ..errors import reason
from .container import Choose, Container, Damage, RawMessage

_ROWS: Final = "SELECT rowid, topic_id, timestamp, data FROM messages WHERE topic_id IN ({})"


class Db3File(Container):
    """A file, opened for reading."""

    def __init__(self, path: Path, choose: Choose, shown: Path | None = None) -> None:
        """Open it; `shown`: what messages call it. Raises ValueError if it is no file of rosbag2,
        and sqlite3's error if it is damaged."""
        super().__init__(shown or path)
        # A recorder that was killed may leave a log beside the file, which only this reads.
        log = path.with_name(path.name + "-wal")
        mode = "mode=ro" if log.exists() and log.stat().st_size else "mode=ro&immutable=1"
        self._database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True)
        try:
            self._database.text_factory = bytes  # it need not be UTF-8
            # Else SQLite refuses a file that is shorter than its first page says.
            self._database.execute("PRAGMA writable_schema = ON")
            self._open(choose)
        except BaseException:
            self.close()
            raise

    def _open(self, choose: Choose) -> None:
        tables = "SELECT name FROM sqlite_master WHERE type = 'table'"
        if not {b"topics", b"messages"} <= {name for (name,) in self._database.execute(tables)}:
            raise ValueError("an SQLite database without the tables of rosbag2")
        topics = self._database.execute("SELECT id, name, type, serialization_format FROM topics")
        self._channels = {
            number: found
            for number, *texts in topics
            if all(isinstance(text, bytes) for text in texts)
            and (found := choose(*(text.decode(errors="replace") for text in texts)))
        }
        with suppress(sqlite3.Error):  # damaged: reading shows it
            self.is_empty = self._first("SELECT 1 FROM messages LIMIT 1") is None
        with suppress(sqlite3.Error):
            count = f"SELECT count(*) FROM messages WHERE topic_id IN ({self._places()})"
            self.message_count = self._first(count, *self._channels)

    def messages(self) -> Iterator[RawMessage]:
        self.damage = Damage()
        last = 0
        rows = _ROWS.format(self._places())
        # The first needs the index of the times, which may be damaged while the rows are not.
        for query in (f"{rows} ORDER BY timestamp", f"{rows} AND rowid > ? ORDER BY rowid"):
            cursor = self._database.execute(query, [*self._channels, last][: query.count("?")])
            while True:
                try:
                    row = cursor.fetchone()
                except sqlite3.Error as error:
                    self.damage.note(f"the row after {last:,}", reason(error))
                    break
                if row is None:
                    return
                last, topic, log_ns, data = row
                if type(log_ns) is int and type(data) is bytes:
                    yield RawMessage(log_ns, self._channels[topic], data)
                else:
                    kinds = f"{type(log_ns).__name__} and {type(data).__name__}"
                    why = f"time and data of a message are {kinds}, not int and bytes"
                    self.damage.note(f"row {last:,} of the table messages", why)

    def close(self) -> None:
        self._database.close()

    def _places(self) -> str:
        return ",".join("?" * len(self._channels))

    def _first(self, query: str, *values: Any) -> Any:
        row = self._database.execute(query, values).fetchone()
        return None if row is None else row[0]
