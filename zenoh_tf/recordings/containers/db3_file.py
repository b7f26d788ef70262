"""Reads db3 files of rosbag2, which are SQLite databases, with Python's own library.

Their messages have no checksum. A row whose columns have other types is left out, and what can be
read before and behind a damaged page is read, also if the index of the times is damaged.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Final

from ...text.reasons import reason
from .container import Choose, Container, Damage, RawMessage

#: Number, topic, time, data. Of a damaged file, the last two have any type.
_Row = tuple[int, int, Any, Any]
_MAX_ROWID: Final = 2**63 - 1
#: What reading a damaged page raises.
_DAMAGE: Final = (sqlite3.DatabaseError, MemoryError)
_ALL: Final = -1  # of SQLite's LIMIT
#: To get past damaged pages: an end to a file that leads in circles.
_MOST_ATTEMPTS: Final = 2000
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
        with suppress(*_DAMAGE):  # damaged: reading shows it
            self.is_empty = self._first("SELECT 1 FROM messages LIMIT 1") is None
        with suppress(*_DAMAGE):
            count = f"SELECT count(*) FROM messages WHERE topic_id IN ({self._places()})"
            self.message_count = self._first(count, *self._channels)

    def messages(self) -> Iterator[RawMessage]:
        self.damage = Damage()
        for number, topic, log_ns, data in self._rows():
            if type(log_ns) is int and type(data) is bytes:
                yield RawMessage(log_ns, self._channels[topic], data)
            else:
                kinds = f"{type(log_ns).__name__} and {type(data).__name__}"
                why = f"time and data of a message are {kinds}, not int and bytes"
                self.damage.note(f"row {number:,} of the table messages", why)

    def _rows(self) -> Iterator[_Row]:
        """The rows by their times. That needs the index of the times; what it hides if it is
        damaged follows by number."""
        by_time = f"{_ROWS.format(self._places())} ORDER BY timestamp"
        count = 0
        try:
            for row in self._database.execute(by_time, [*self._channels]):
                count += 1
                yield row
        except _DAMAGE as error:
            why = reason(error)
        else:
            return
        # Asked for again, as a file that is not damaged then needs no memory for their numbers.
        again = self._database.execute(by_time, [*self._channels]) if count else ()
        given = {row[0] for row in islice(again, count)}
        yield from (row for row in self._rows_by_number() if row[0] not in given)
        if not self.damage.count:
            self.damage.note("the index of the times", why)

    def _rows_by_number(self) -> Iterator[_Row]:
        """The rows by their numbers, also behind damaged pages."""
        by_number = f"{_ROWS.format(self._places())} AND rowid > ? ORDER BY rowid LIMIT ?"
        # Not 0: a search for a number may be led astray in a damaged first page.
        last, step = -_MAX_ROWID, 0
        most = _ALL
        is_noted = False  # the damage behind the last row
        for _ in range(_MOST_ATTEMPTS):
            above = last + step
            try:
                for row in self._database.execute(by_number, [*self._channels, above, most]):
                    # A damaged page may have any numbers: they never lead back.
                    last, step = max(last, row[0], above + 1 if most == 1 else last), 0
                    is_noted = is_noted and most == 1
                    yield row
            except _DAMAGE as error:
                last = max(last, 0)
                if not is_noted:
                    self.damage.note(f"the row after {last:,}", reason(error))
                is_noted = True
                if isinstance(error, sqlite3.OperationalError):  # such as a lock
                    return
                # SQLite does not say how many rows a page has. Longer steps would skip good rows
                # behind it, and single ones take long where a page that leads to many is damaged.
                if most == 1:
                    step += 1 + step // 8
                if last + step > _MAX_ROWID:
                    return
                # Python fetches one row ahead, and loses the one before the damage.
                most = 1
            else:
                if most == _ALL:
                    return
                most = _ALL

    def close(self) -> None:
        self._database.close()

    def _places(self) -> str:
        return ",".join("?" * len(self._channels))

    def _first(self, query: str, *values: Any) -> Any:
        row = self._database.execute(query, values).fetchone()
        return None if row is None else row[0]
