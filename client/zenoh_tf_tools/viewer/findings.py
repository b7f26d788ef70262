"""Runs the doctor beside the viewer, in a thread of its own: observing takes seconds."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Generator, Mapping
from typing import Final

from zenoh_tf import TransformException, threads
from zenoh_tf.recordings import RecordingError
from zenoh_tf_tools.doctor import Finding, TreeFacts, diagnose

#: The pause after an observation, in seconds, so that the server has time for others.
_PAUSE_S: Final = 5.0
#: So often it is asked whether someone looks, in seconds, before the first observation.
_IDLE_S: Final = 0.5

#: Yields the facts about the tree, each time that it is asked, which may take seconds; it ends if
#: they do not change any more, as of a recording. It asks what it is given whether to stop.
Observe = Callable[[Callable[[], bool]], Generator[TreeFacts, None, None]]


class Findings:
    """The faults of the tree as of the last observation.

    Thread safety: all methods.
    """

    def __init__(self, observe: Observe, *, wanted: Callable[[], bool]) -> None:
        """Begin to observe.

        Args:
            observe: Gathers the facts.
            wanted: Whether someone looks; if nobody does, nothing is observed.
        """
        self._observe = observe
        self._wanted = wanted
        self._closed = threading.Event()
        self._found: list[Finding] | None = None
        self._thread = threads.start("zenoh-tf view: doctor", self._run)

    @property
    def found(self) -> list[Finding] | None:
        """The faults; None before the first observation has ended."""
        return self._found

    def of_frames(self) -> Mapping[str, str]:
        """Return the title of the first fault of each frame that has one."""
        titles: dict[str, str] = {}
        for finding in self._found or ():
            titles.setdefault(finding.subject, finding.fault.title)
        return titles

    def of(self, frame: str) -> list[Finding]:
        """Return the faults of one frame."""
        return [finding for finding in self._found or () if finding.subject == frame]

    def close(self) -> None:
        """Observe no more, and wait until the thread has ended."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closed.is_set():
            if self._wanted():
                try:
                    if self._look():
                        return
                except (TransformException, RecordingError):
                    # The server is away, which the viewer says; the faults are as they were.
                    pass
            self._closed.wait(_PAUSE_S if self._found is not None else _IDLE_S)

    def _look(self) -> bool:
        """Observe until nobody looks. Returns whether there is nothing more to observe."""
        with contextlib.closing(self._observe(self._closed.is_set)) as looks:
            for facts in looks:
                self._found = diagnose(facts)
                if not self._wanted() or self._closed.wait(_PAUSE_S):
                    return False
        return True
