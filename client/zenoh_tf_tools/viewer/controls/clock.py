"""The controls of the time that is shown: of a recording any, of a live tree the last seconds."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import viser

_SPEEDS: Final = ("0.1 x", "0.5 x", "1 x", "2 x", "5 x", "20 x")
_BACK: Final = "◀ step"
_FORTH: Final = "step ▶"
#: So far the slider of a live tree goes back: a server's history is as long if no one says else.
_BACK_S: Final = 10.0


class Clock:
    """Shows and chooses the time. The viewer's thread asks it for each picture."""

    def __init__(self, gui: viser.GuiApi, range_ns: tuple[int, int] | None, at_ns: int) -> None:
        """Make the controls.

        Args:
            gui: Where to.
            range_ns: The times that can be chosen, in nanoseconds; None for a live tree.
            at_ns: The one of them to begin with.
        """
        self._range_ns = range_ns
        self._time_ns = at_ns
        #: Where the slider is 0: at the first time of a recording, or where a live tree pauses.
        self._zero_ns = at_ns if range_ns is None else range_ns[0]
        self._steps = deque[int](maxlen=8)
        if range_ns is not None:
            self._least_s, self.length_s = 0.0, max(0.01, (range_ns[1] - range_ns[0]) / 1e9)
            hint = None
        else:
            self._least_s, self.length_s = -_BACK_S, 0.0
            hint = "how long ago; the picture pauses, at a time that the history has"
        self._slider: Any = gui.add_slider(
            "time [s]", self._least_s, self.length_s, 0.01, self._slider_s(), hint=hint
        )
        self._shown_s = float(self._slider.value)
        if range_ns is not None:
            self.play: Any = gui.add_checkbox("play", False, hint="let the time run")
            self._speed: Any = gui.add_dropdown("speed", _SPEEDS, initial_value="1 x")
            hint = "to the next sample of the picked frame, or of any"
        else:
            self.play = gui.add_checkbox("live", True, hint="without the mark the picture pauses")
            hint = "while paused: by a period of the picked frame, or 0.1 s"
        step = gui.add_button_group("step", (_BACK, _FORTH), hint=hint)
        step.on_click(lambda event: self._steps.append(1 if event.target.value == _FORTH else -1))

    @property
    def running(self) -> bool:
        """Whether the time runs by itself."""
        return bool(self.play.value)

    def next_ns(self, elapsed_s: float, now_ns: int) -> int:
        """Return the time of the next picture, in nanoseconds, before steps.

        Args:
            elapsed_s: Seconds since the last picture.
            now_ns: What a live tree shows, in nanoseconds.
        """
        if self._slider.value != self._shown_s:  # a person has moved it
            if self._range_ns is None:
                self.play.value = False
                self._steps.append(0)  # which the source moves to where it has samples
            self._go_to(self._zero_ns + round(self._slider.value * 1e9))
        elif self.running and self._range_ns is not None:
            speed = float(self._speed.value.split()[0])
            self._go_to(self._time_ns + round(elapsed_s * speed * 1e9))
            if self._time_ns >= self._range_ns[1]:
                self.play.value = False
        elif self.running:
            self._zero_ns = now_ns
            self._go_to(now_ns)
        return self._time_ns

    def steps(self) -> list[int]:
        """Return the steps that a person has asked for since the last call: 1 or -1 each, and 0
        for a time of a live tree that they have chosen."""
        return [self._steps.popleft() for _ in range(len(self._steps))]

    def step_to(self, time_ns: int) -> int:
        """Show this time, and stop there. Returns it, within the range."""
        self.play.value = False
        self._go_to(time_ns)
        return self._time_ns

    def _go_to(self, time_ns: int) -> None:
        if self._range_ns is not None:
            time_ns = min(max(time_ns, self._range_ns[0]), self._range_ns[1])
        self._time_ns = time_ns
        self._shown_s = self._slider_s()
        if self._slider.value != self._shown_s:
            self._slider.value = self._shown_s

    def _slider_s(self) -> float:
        seconds = (self._time_ns - self._zero_ns) / 1e9
        return round(min(max(self._least_s, seconds), self.length_s), 2)
