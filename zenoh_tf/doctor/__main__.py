"""``python -m zenoh_tf.doctor > docs/doctor.md`` writes the page about the catalogue."""

from __future__ import annotations

from collections.abc import Iterator

from zenoh_tf.doctor.catalogue import CATALOGUE


def page() -> Iterator[str]:
    """The lines of docs/doctor.md."""
    yield "# Doctor"
    yield ""
    yield "`zenoh-tf doctor` looks at a served tree for some seconds and reports the faults of"
    yield "this catalogue that it finds, each with its evidence. Exit code 0: none; 3: some; 1: it"
    yield "could not look. `--ignore TF301` leaves one out, `--for 10` looks for ten seconds, and"
    yield "`--json` prints one document. `zenoh-tf explain` says what a single lookup suffers from:"
    yield "see [troubleshooting](troubleshooting.md)."
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
