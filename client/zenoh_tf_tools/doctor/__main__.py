"""``python -m zenoh_tf_tools.doctor`` prints the page about the catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from zenoh_tf_tools.doctor.catalogue import CATALOGUE

_INTRODUCTION: Final = """\
# Doctor

`zenoh-tf doctor` watches a served tree for some seconds, or reads a recording
(`zenoh-tf doctor drive.mcap`), and reports the faults of this catalogue that it finds,
each with its evidence. Exit code 0: none; 3: some; 1: it could not look. `--ignore
TF301` leaves one out, `--for 10s` watches for ten seconds, and `--json` prints one
document. `zenoh-tf explain` says what a single lookup suffers from: see
[troubleshooting](../how-to/troubleshooting.md).

It judges by the samples as they arrive, so a link has stopped if nothing comes, whatever
its stamps say. It sees the history that the server has, every sample that comes while it
watches, and how the counters grow meanwhile; what was before is not reported. Exceptions
are refused transforms whose frame is missing still, a link that was switched between
static and dynamic last, and for ten minutes a static value that was replaced and a time
that was set back. A fault that follows from another one on the same link or by the same
publisher has no line of its own.

A recording does not say who published what, so its topics stand for the publishers, and
the time of its log for the arrivals. Only the messages show quaternions that are not of
length 1 (TF401); what a server has refused is TF106. Nor does it say what was looked up,
so whether a link is too slow (TF107) is judged by the rates of its chain alone.

In a program, `zenoh_tf_tools.doctor.diagnose` makes findings from plain facts. Without samples,
which `zenoh_tf_tools.doctor.Observation` gathers, it judges the records of the frames alone:

```python
from zenoh_tf_tools.doctor import LinkFacts, TreeFacts, diagnose

links = [LinkFacts(tree.frame(name)) for name in tree.frames()]
for finding in diagnose(TreeFacts(links, now_ns=time.time_ns())):
    print(finding.fault.id, finding.subject, finding.evidence)
```
"""


def page() -> Iterator[str]:
    """The lines of docs/reference/doctor.md."""
    yield from _INTRODUCTION.splitlines()
    for fault in CATALOGUE:
        yield ""
        yield f"## {fault.id}: {fault.title}"
        yield ""
        yield fault.explanation
        yield ""
        yield f"**What to do.** {fault.remedy}"


if __name__ == "__main__":
    print("\n".join(page()))
