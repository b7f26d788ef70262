"""What `explain` returns: the chain of a lookup link by link, and sentences about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from zenoh_tf.text import printable
from zenoh_tf.text.times import age, milliseconds, seconds

__all__ = ["Explanation", "LinkReport"]

_COLUMNS: Final = ("rate [Hz]", "age [s]", "oldest [s]", "newest [s]", "samples", "authority", "")
_PROBLEMS: Final = {
    "too_new": "ends {} before",
    "too_old": "begins {} after",
    "single_sample": "one sample, {} off",
}


@dataclass(frozen=True, slots=True)
class LinkReport:
    """One link of a chain.

    Attributes:
        child: Its child frame.
        parent: Its parent frame, at the time that was asked for if the link has data there.
        authority: Authority that wrote it last; empty if it gave no name.
        static: Whether it holds at all times.
        samples: Samples in its history.
        rate_hz: Samples per second; ``None`` for a static link or a single sample.
        oldest_stamp_ns: Oldest stamp in nanoseconds; ``None`` for a static link.
        newest_stamp_ns: Newest stamp in nanoseconds; ``None`` for a static link.
        age_s: How old the newest stamp is; see `Explanation.by_clock`.
        stopped: No sample has come for much longer than its rate lets expect.
        problem: Why it has no data for the time of the lookup: ``too_new`` (the time is after its
            newest sample), ``too_old`` (before its oldest) or ``single_sample``; ``None``: it has.
        off_by_ns: By how many nanoseconds the time lies outside of its data.
        gap_ns: The gap that the link is interpolated over, nanoseconds; 0: none.
    """

    child: str
    parent: str
    authority: str
    static: bool
    samples: int
    rate_hz: float | None
    oldest_stamp_ns: int | None = None
    newest_stamp_ns: int | None = None
    age_s: float | None = None
    stopped: bool = False
    problem: Literal["too_new", "too_old", "single_sample"] | None = None
    off_by_ns: int | None = None
    gap_ns: int = 0


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why a lookup succeeds or fails, as of one instant. `print` shows it as text.

    Attributes:
        target: The lookup's target.
        source: The lookup's source.
        stamp_ns: The time asked for, nanoseconds; ``None``: the latest common time.
        at_ns: The time that the lookup is answered for; ``None`` if all links are static, or there
            is no chain.
        possible: Whether the lookup succeeds.
        error: Name of the error that it raises; ``None`` if it succeeds.
        links: The links of the chain from target to source.
        limiting_frame: The child frame of the link that the lookup fails at, or that ends first and
            so limits the latest common time; ``None`` without a dynamic link.
        target_root: The root of the target's tree; ``None`` if the frame is unknown.
        source_root: The same of the source.
        by_clock: Ages are counted from this machine's clock. False: the stamps are of another
            clock, and ages are counted from the newest stamp of the chain.
        reasons: Sentences that say why.
        advice: Sentences that say what to do.
    """

    target: str
    source: str
    stamp_ns: int | None
    at_ns: int | None = None
    possible: bool = False
    error: str | None = None
    links: tuple[LinkReport, ...] = ()
    limiting_frame: str | None = None
    target_root: str | None = None
    source_root: str | None = None
    by_clock: bool = True
    reasons: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return all of it as JSON values."""
        return asdict(self)

    def text(self, paint: Callable[[str, str], str] = lambda part, text: text) -> str:
        """Return a table of the links and the sentences.

        Args:
            paint: As of `zenoh_tf.export.text`.
        """
        when = "the latest common time" if self.stamp_ns is None else f"{seconds(self.stamp_ns)} s"
        source, target = (paint("frame", printable(n)) for n in (self.source, self.target))
        lines = [f"{source} in {target} at {when}"]
        if self.links:
            lines += ["", *self._table(paint)]
        lines += ["", *map(printable, self.reasons)]
        if self.advice:
            lines += ["", *(f"- {printable(sentence)}" for sentence in self.advice)]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.text()

    def _table(self, paint: Callable[[str, str], str]) -> list[str]:
        header = ("parent -> child", *_COLUMNS)
        rows = [self._cells(link) for link in self.links]
        widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
        lines = []
        for number, row in enumerate([header, *rows]):
            name, *numbers, authority, note = row
            line = f"  {name:<{widths[0]}}"
            line += "".join(f"  {n:>{w}}" for n, w in zip(numbers, widths[1:-2], strict=True))
            line = f"{line}  {authority:<{widths[-2]}}  {note}".rstrip()
            link = self.links[number - 1] if number else None
            is_late = link is not None and (link.problem or link.stopped or link.gap_ns)
            part = "header" if link is None else "late" if is_late else ""
            lines.append(paint(part, line))
        return lines

    def _cells(self, link: LinkReport) -> tuple[str, ...]:
        name = f"{printable(link.parent)} -> {printable(link.child)}"
        if link.oldest_stamp_ns is None or link.newest_stamp_ns is None or link.age_s is None:
            return (name, "static", "", "", "", str(link.samples), printable(link.authority), "")
        notes = []
        if link.problem is not None:
            notes.append(_PROBLEMS[link.problem].format(age(link.off_by_ns or 0)))
        elif link.child == self.limiting_frame and len(self.links) > 1:
            notes.append("ends first")
        if link.stopped:
            notes.append("stopped")
        if link.gap_ns:
            notes.append(f"in a gap of {age(link.gap_ns)}")
        return (
            name,
            "-" if link.rate_hz is None else f"{link.rate_hz:.1f}",
            f"{link.age_s:.3f}",
            milliseconds(link.oldest_stamp_ns),
            milliseconds(link.newest_stamp_ns),
            str(link.samples),
            printable(link.authority),
            f"<- {', '.join(notes)}" if notes else "",
        )
