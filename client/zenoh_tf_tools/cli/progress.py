"""A progress bar on stderr, drawn only if stderr is a terminal."""

from __future__ import annotations

import shutil
import sys
import time

from zenoh_tf_tools.cli.output import is_unicode

_PARTS = " ▏▎▍▌▋▊▉█"
_REDRAW_S = 0.1


class Progress:
    """A context manager; draws at most ten times a second, however often ``to`` is called."""

    def __init__(self, total: int | None, unit: str) -> None:
        """``total``: how much there is to do; None if nobody knows, then there is no bar."""
        self._total = total
        self._unit = unit
        self._on = sys.stderr.isatty()
        self._ascii = not is_unicode(sys.stderr)
        self._drawn = 0.0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._on:
            # Erase the bar, so that other output starts on a clean line.
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def to(self, done: int, *, note: str = "") -> None:
        """Draw the bar for ``done`` of the total, with a note after it."""
        now = time.monotonic()
        is_last = self._total is not None and done >= self._total
        if not self._on or (now - self._drawn < _REDRAW_S and not is_last):
            return
        self._drawn = now
        text = f" {done:,} {self._unit}  {note}".rstrip()
        bar, width = "", 0
        if self._total is not None:
            total = max(self._total, 1)
            text = f" {100 * done // total:3d} % {text}"
            width = max(5, min(40, shutil.get_terminal_size().columns - len(text) - 1))
            eighths = 8 * width * min(done, total) // total
            bar = "█" * (eighths // 8) + (_PARTS[eighths % 8] if eighths < 8 * width else "")
            if self._ascii:
                bar = "#" * (eighths // 8)
        sys.stderr.write(f"\r{bar:<{width}}{text}\x1b[K")
        sys.stderr.flush()
