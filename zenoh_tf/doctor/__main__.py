"""``python -m zenoh_tf.doctor > docs/reference/doctor.md`` writes the page about the catalogue."""

from __future__ import annotations

from collections.abc import Iterator

from zenoh_tf.doctor.catalogue import CATALOGUE


def page() -> Iterator[str]:
    """The lines of docs/reference/doctor.md."""
    yield "# Doctor"
    yield ""
    yield "`zenoh-tf doctor` observes a served tree for some seconds, or reads a recording"
    yield "(`zenoh-tf doctor drive.mcap`), and reports the faults of this catalogue that it finds,"
    yield "each with its evidence. Exit code 0: none; 3: some; 1: it could not look. `--ignore"
    yield "TF301` leaves one out, `--for 10s` observes for ten seconds, and `--json` prints one"
    yield "document. `zenoh-tf explain` says what a single lookup suffers from: see"
    yield "[troubleshooting](../how-to/troubleshooting.md)."
    yield ""
    yield "A recording does not say who published what, so its topics stand for the publishers."
    yield "Only the messages show quaternions that are not of length 1 (TF401); what a server has"
    yield "refused is TF106."
    yield ""
    yield "In a program, `zenoh_tf.doctor.diagnose` makes the same findings from plain facts:"
    yield ""
    yield "```python"
    yield "from zenoh_tf.doctor import LinkFacts, TreeFacts, diagnose"
    yield ""
    yield "links = [LinkFacts(tree.frame(name)) for name in tree.frames()]"
    yield "for finding in diagnose(TreeFacts(links, now_ns=time.time_ns())):"
    yield "    print(finding.fault.id, finding.subject, finding.evidence)"
    yield "```"
    for fault in CATALOGUE:
        yield ""
        yield f"## {fault.id}: {fault.title}"
        yield ""
        yield fault.explanation
        yield ""
        yield f"**What to do.** {fault.remedy}"


if __name__ == "__main__":
    print("\n".join(page()))
