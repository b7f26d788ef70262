"""Which fault is the consequence of which: the consequence has no line beside its cause."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final

from zenoh_tf.text.similar import spelling
from zenoh_tf_tools.doctor.facts import TreeFacts
from zenoh_tf_tools.doctor.findings import Finding

#: The faults that cause one, on the same link or by the same authority.
_CAUSES: Final[dict[str, Collection[str]]] = {
    "TF101": {"TF102", "TF103", "TF402"},
    "TF104": {"TF108", "TF207"},
    "TF105": {"TF104", "TF101", "TF108", "TF207"},
    "TF107": {
        *("TF102", "TF103", "TF104", "TF105", "TF106", "TF108"),
        *("TF201", "TF203", "TF205", "TF206", "TF207", "TF208", "TF210"),
    },
    "TF201": {"TF203", "TF206", "TF207"},
    "TF202": {"TF201", "TF206", "TF207", "TF208"},
    "TF203": {"TF101", "TF102"},
    "TF204": {"TF101", "TF201", "TF202", "TF205", "TF207"},
    "TF205": {"TF101", "TF202", "TF207"},
    "TF206": {"TF101", "TF203", "TF207"},
    "TF208": {"TF101", "TF203", "TF206", "TF210"},
    "TF209": {"TF101", "TF202", "TF204", "TF205", "TF208"},
    "TF210": {"TF101", "TF105", "TF208"},
    "TF402": {"TF103", "TF405"},
    "TF403": {"TF101", "TF102", "TF202", "TF203", "TF205", "TF405"},
    "TF404": {"TF101", "TF203"},
    "TF405": {"TF101"},
    "TF407": {"TF101", "TF403", "TF405"},
}


def without_consequences(findings: list[Finding], facts: TreeFacts) -> list[Finding]:
    """Return the findings without those that others explain.

    Args:
        findings: All findings.
        facts: What they were found in.
    """
    found = {(finding.fault.id, finding.subject) for finding in findings}
    alike = {spelling(subject) for fault, subject in found if fault == "TF302"}

    def is_explained(finding: Finding) -> bool:
        fault, subject = finding.fault.id, finding.subject
        if fault == "TF301":  # a root, or a frame below it, is the other tree's root misspelt
            own_names = {spelling(name) for name in facts.roots[subject]}
            others = {spelling(root) for root in facts.roots if root != subject}
            return spelling(subject) in alike or bool(own_names & others & alike)
        causes = _CAUSES.get(fault, ())
        frame = facts.frames.get(subject)
        if frame is not None:
            subjects: Iterable[str] = {subject, frame.authority}
            return any((cause, name) in found for cause in causes for name in subjects)
        # An authority: all its links have the cause, or it has itself.
        own = [link.frame.name for link in facts.dynamic if link.frame.authority == subject]
        return any(
            (cause, subject) in found or (own and all((cause, name) in found for name in own))
            for cause in causes
        )

    return [finding for finding in findings if not is_explained(finding)]
