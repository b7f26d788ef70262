"""The thread that writes the state file: everything that came in meanwhile is one transaction.

Thread safety: all methods.
Invariant: changes that were put together are written together, and in the order of their puts:
of two changes of one entry the later one counts. A write that failed is repeated until it succeeds.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
import time
from typing import Final

from zenoh_tf import threads
from zenoh_tf.errors import NotDurable

from .file import Changes, StateFile

log = logging.getLogger("zenoh_tf.server.state")

#: A write that failed is tried again after this time, or with the next change.
_RETRY_S: Final = 2.0
#: How long a client's write waits for the disk.
WAIT_S: Final = 3.0
#: On closing, for the last changes.
STORE_TIMEOUT_S: Final = 1.0


class StateWriter:
    """Writes changes to a state file, off the threads that make them."""

    def __init__(self, file: StateFile) -> None:
        self._file = file
        self._changed = threading.Condition()
        # Guarded by the condition. Numbers count the calls of `put`.
        self._pending: Changes = {}
        self._last_number = 0
        self._durable_number = 0
        self._failed_number = 0  # the last number in the write that failed last
        self._failure = ""
        self._writing_since_s: float | None = None
        self._writing = 0  # entries of the write that runs
        self._closing = False
        self._thread = threads.start("state", self._run)

    def put(self, changes: Changes) -> int:
        """Queue changes to write. Returns the number to `wait` for. Never blocks for long."""
        with self._changed:
            self._pending.update(changes)
            self._last_number += 1
            self._changed.notify_all()
            return self._last_number

    def wait(self, number: int) -> None:
        """Wait until the changes with a number, and those before, are durable.

        Raises:
            NotDurable: Writing them failed, or took too long. They are tried again.
        """
        started_s = time.monotonic()
        with self._changed:
            while self._durable_number < number:
                if self._failed_number >= number:
                    raise self._not_durable(self._failure)
                # Behind a write that hangs for that long already nobody waits: each thread that
                # waits here is one that serves no other client.
                since_s = min(started_s, self._writing_since_s or started_s)
                left_s = since_s + WAIT_S - time.monotonic()
                if left_s <= 0:
                    raise self._not_durable(f"the disk did not answer within {WAIT_S:g} s")
                self._changed.wait(left_s)

    @property
    def pending(self) -> int:
        """How many entries are not durable yet."""
        with self._changed:
            return len(self._pending) + self._writing

    def close(self) -> None:
        """Write what is pending, once more if the last write failed; end the thread and close the
        file, unless the disk does not answer."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        threads.join(self._thread, timeout_s=STORE_TIMEOUT_S)
        if self._thread.is_alive():
            log.error("the state is not stored: the disk does not answer")
        else:
            self._file.close()

    def _not_durable(self, reason: str) -> NotDurable:
        return NotDurable(
            f"the write was applied, but the server cannot store it: {reason}; it would be lost "
            "if the server ended now. The server keeps trying to store it; do not send it again",
            field="state_dir",
        )

    def _run(self) -> None:
        retry = False
        while True:
            with self._changed:
                if retry and not self._closing and self._last_number == self._failed_number:
                    self._changed.wait(_RETRY_S)
                while not self._pending and not self._closing:
                    self._changed.wait()
                if not self._pending:
                    return
                batch, self._pending = self._pending, {}
                number, closing = self._last_number, self._closing
                self._writing, self._writing_since_s = len(batch), time.monotonic()
            failed_before, retry = retry, not self._write(batch, number)
            if retry and not failed_before:
                log.error("cannot store the state %s: %s", self._file.path, self._failure)
            elif failed_before and not retry:
                log.warning("the state %s is stored again", self._file.path)
            if retry and closing:
                log.error("%d entries of the state are lost", len(batch))
                return

    def _write(self, batch: Changes, number: int) -> bool:
        """Write one batch. False: it failed, and is pending again."""
        try:
            self._file.write(batch)
        except Exception as error:  # no error may end the thread
            if not isinstance(error, sqlite3.Error):
                log.exception("internal error while storing the state")
            with self._changed:
                self._pending = batch | self._pending
                self._writing, self._writing_since_s = 0, None
                self._failed_number = number
                self._failure = f"{self._file.path}: {error}"
                self._changed.notify_all()
            return False
        with self._changed:
            self._writing, self._writing_since_s = 0, None
            self._durable_number = number
            self._changed.notify_all()
        return True
