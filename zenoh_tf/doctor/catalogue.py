"""The catalogue of faults. ``python -m zenoh_tf.doctor`` makes docs/reference/doctor.md of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Final

from zenoh_tf.doctor import checks
from zenoh_tf.doctor.facts import TreeFacts


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that the doctor can find.

    Attributes:
        id: Its number, which never changes.
        title: What it is.
        explanation: What it means for lookups, and what usually causes it.
        remedy: What to do.
        check: Finds it: the subjects, each with its evidence.
    """

    id: str
    title: str
    explanation: str
    remedy: str
    check: Callable[[TreeFacts], Iterator[tuple[str, str]]]


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault that was found.

    Attributes:
        fault: Which one.
        subject: The frame, authority or client that has it.
        evidence: A sentence with the figures.
    """

    fault: Fault
    subject: str
    evidence: str

    def document(self) -> dict[str, str]:
        """Return it as JSON values."""
        return {
            "id": self.fault.id,
            "title": self.fault.title,
            "subject": self.subject,
            "evidence": self.evidence,
            "explanation": self.fault.explanation,
            "remedy": self.fault.remedy,
        }


CATALOGUE: Final = (
    Fault(
        "TF101",
        "two publishers of one frame",
        "Two authorities write the same link by turns, so lookups jump between two poses. Often an "
        "old driver still runs, or a simulator beside the robot.",
        "End one of them; `zenoh-tf authorities` and `zenoh-tf frame NAME` show them. The "
        "server's `--one-authority-per-frame` refuses the second.",
        checks.two_publishers,
    ),
    Fault(
        "TF102",
        "a frame that flips between parents",
        "The frame's parent changes to and fro, so a chain exists at some times only. Two "
        "publishers disagree where the frame hangs.",
        "Let one publisher own the link. If both poses are wanted, give one of them another name.",
        checks.flip_flop,
    ),
    Fault(
        "TF103",
        "a static frame that is also published as dynamic",
        "Each switch between static and dynamic clears the link's history, so lookups at past "
        "times fail. A static publisher and a sensor or a state publisher write the same link.",
        "Publish the link as static or as dynamic. A link that never moves is better static.",
        checks.static_and_dynamic,
    ),
    Fault(
        "TF104",
        "a link that has stopped",
        "No sample has come for 10 periods and a second at least. Lookups at the present fail, and "
        "the latest common time of every chain over the link stands still.",
        "Restart its publisher, or find why its messages do not arrive. `zenoh-tf explain` shows "
        "what a lookup over the link makes of it.",
        checks.stopped,
    ),
    Fault(
        "TF105",
        "a link with gaps",
        "The samples of the link come with pauses of 10 periods and half a second at least. "
        "Lookups in a gap interpolate over it, and lookups at the present fail meanwhile.",
        "Look at the load of its publisher, at the network, and at the drops that `zenoh-tf "
        "authorities` counts.",
        checks.sagging,
    ),
    Fault(
        "TF106",
        "transforms that were refused",
        "What this authority publishes is not stored: a number is not finite, a quaternion is not "
        "of length 1, a link would close a loop, or a limit is reached.",
        "The evidence has the reason of the last refusal, which names the frame.",
        checks.refused,
    ),
    Fault(
        "TF201",
        "a clock that is off",
        "The stamps of one computer do not fit those of the others, so lookups across them fail or "
        "join poses of different times.",
        "Synchronise the clocks (chrony, PTP). docs/explanation/clocks.md says how the offsets are "
        "measured.",
        checks.skewed_clock,
    ),
    Fault(
        "TF202",
        "stamps from the future",
        "The newest sample is ahead of the clock. Lookups at the present work, but interpolate "
        "towards a pose that nobody has measured yet. Some localisations do so on purpose.",
        "Check the clock of its publisher, or lower its transform tolerance.",
        checks.future_stamps,
    ),
    Fault(
        "TF203",
        "repeated stamps",
        "Samples come at stamps that the link has already, and the last one replaces the others. "
        "A clock stands still, one message arrives by two routes, or a publisher repeats itself.",
        "Send each sample once, with the time of its measurement.",
        checks.repeated_stamps,
    ),
    Fault(
        "TF204",
        "transforms older than the cache",
        "They arrived later than the cache time after newer ones of the same link, and were "
        "dropped. A second publisher has another clock, or a recording is played again.",
        "Find their publisher in the `dropped` column of `zenoh-tf authorities`.",
        checks.too_old,
    ),
    Fault(
        "TF205",
        "time was set back",
        "Stamps jumped back by more than the cache time, and the link's history was cleared. A "
        "simulator was reset, or a clock was corrected.",
        "Nothing, if that was meant. Else see docs/explanation/clocks.md.",
        checks.time_jumps,
    ),
    Fault(
        "TF301",
        "trees that are not connected",
        "No lookup works between frames of different trees. A link is missing, or one of its two "
        "frames is misspelt.",
        "Publish the pose of the smaller tree's root in a frame of the other one. Independent "
        "robots on one server may stay apart: ignore this then.",
        checks.unconnected,
    ),
    Fault(
        "TF302",
        "names that differ by slashes or case",
        "They are different frames, though a person would confuse them.",
        "Choose one spelling, and remove the other frame with `zenoh-tf remove`.",
        checks.alike_names,
    ),
    Fault(
        "TF303",
        "a very deep tree",
        "Every link of a chain costs time, and its data may be missing. Often each "
        "pose, as of a trajectory, gets a name of its own.",
        "Hang the frames below a common parent, or keep poses that are no frames elsewhere.",
        checks.deep,
    ),
    Fault(
        "TF401",
        "quaternions that are not of length 1",
        "They are no rotations. Up to a hundredth off they are normalised, beyond that refused.",
        "Normalise them where they are made; a length of 0 often is a message that nobody filled.",
        checks.not_unit,
    ),
)

_BY_ID: Final = {fault.id: fault for fault in CATALOGUE}


def diagnose(facts: TreeFacts, ignore: Collection[str] = ()) -> list[Finding]:
    """Return all faults in the facts about a tree, in the order of the catalogue.

    Args:
        facts: What is known about the tree.
        ignore: Ids of faults that are not searched for.

    Raises:
        ValueError: An id is not in the catalogue.
    """
    for name in ignore:
        if name not in _BY_ID:
            raise ValueError(f"there is no fault {name!r}; docs/reference/doctor.md lists them")
    return [
        Finding(fault, subject, evidence)
        for fault in CATALOGUE
        if fault.id not in ignore
        for subject, evidence in fault.check(facts)
    ]
