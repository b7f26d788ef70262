"""The key ``q``, which ends a command that otherwise runs until Ctrl-C, if it has a terminal."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from zenoh_tf import threads

_POLL_S: Final = 0.1


@contextmanager
def ends_on_q() -> Iterator[None]:
    """End the block, and nothing else, when the user presses q.

    The block ends by a KeyboardInterrupt as by Ctrl-C, which is not raised further. Without a
    terminal for input and output, or in the background, nothing is read.
    """
    # Without an input at all, Python has no `stdin`.
    has_terminal = sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()
    if not has_terminal or not _is_in_foreground():
        yield
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    ended, pressed = threading.Event(), threading.Event()
    thread = None
    try:
        thread = threads.start("quit key", _read_keys, terminal, ended, pressed)
        yield
    except KeyboardInterrupt:
        if not pressed.is_set():
            raise
    finally:
        ended.set()
        threads.join(thread)
        if _is_in_foreground():
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _read_keys(terminal: int, ended: threading.Event, pressed: threading.Event) -> None:
    while not ended.is_set():
        # A process in the background that reads from its terminal would be stopped.
        if not _is_in_foreground():
            ended.wait(_POLL_S)
            continue
        if termios.tcgetattr(terminal)[3] & termios.ICANON:
            # At first, and after the shell had the terminal: keys come at once, and are not shown.
            # Ctrl-C and Ctrl-Z are as before.
            tty.setcbreak(terminal, termios.TCSANOW)
        if select.select([terminal], [], [], _POLL_S)[0]:
            keys = b""
            with suppress(OSError):
                keys = os.read(terminal, 64)
            if not keys:
                return  # the terminal was closed
            if b"q" in keys.lower() and not ended.is_set():
                pressed.set()
                # Wakes the main thread from whatever it waits for.
                main = threading.main_thread().ident
                assert main is not None
                signal.pthread_kill(main, signal.SIGINT)
                return


def _is_in_foreground() -> bool:
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False
