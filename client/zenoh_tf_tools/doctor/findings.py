"""What the doctor finds: a fault of the catalogue, somewhere in a tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from zenoh_tf_tools.doctor.facts import TreeFacts
from zenoh_tf_tools.doctor.words import Evidence


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
    check: Callable[[TreeFacts], Evidence]


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
