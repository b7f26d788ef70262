"""What the panel says, as HTML.

Frames and authorities may have any name. So names are shown as escaped HTML, never through viser's
Markdown: its pages execute expressions in it.
"""

from __future__ import annotations

import html
import re
import time
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import Estimate, Transform, TransformException, Velocity
from zenoh_tf.text import cut, printable
from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.doctor import Finding
from zenoh_tf_tools.doctor.facts import SIMULATED_NS
from zenoh_tf_tools.estimate_words import bounds, carried_on
from zenoh_tf_tools.viewer.placement import Placement
from zenoh_tf_tools.viewer.source import ViewedLink

#: Names of one list in the panel; more are counted.
_LISTED: Final = 8
#: Faults in the panel; more are counted.
_FAULTS: Final = 20
#: From this age on, a time that is shown is said to be past.
_AGO_NS: Final = 500_000_000
#: Stamps after 2096 are of no clock.
_MAX_DATE_NS: Final = 4 * 10**18
_RED: Final = "#d22"
PURPLE: Final = "#a0a"

EMPTY_HTML: Final = (
    "<b>The tree has no frames yet.</b><br>They appear here as soon as someone publishes one. "
    "To try it:<pre style='margin:0.4em 0;white-space:pre-wrap'>zenoh-tf set map base_link 1 2 0"
    "</pre>If there should be some: does the publisher use the same server and the same tree as "
    "this page (<code>--connect</code>, <code>--tree</code>)? <code>zenoh-tf authorities</code> "
    "lists who publishes."
)


def figures_html(
    link: ViewedLink | None,
    placement: Placement,
    fixed: str,
    velocity: Velocity | None,
    estimate: Estimate | TransformException | None,
    findings: Sequence[Finding],
) -> str:
    """The figures of one frame.

    Args:
        link: The frame; None if none is picked.
        placement: Where the frames are.
        fixed: The fixed frame.
        velocity: How the frame moves in the fixed frame; None if that is not known.
        estimate: Where it is now in the fixed frame, or why that is not known; None if nobody
            asked.
        findings: The faults of the frame.
    """
    if link is None:
        return block("Click a frame in the scene, or choose one above.")
    facts = {"parent": "none, it is a root" if link.parent is None else name_html(link.parent)}
    if link.parent is not None:
        facts["authority"] = name_html(link.authority) if link.authority else "-"
        facts["age"] = _age(link)
        if not link.static:
            facts["rate"] = "-" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"
    row = placement.rows.get(link.name)
    if row is None:
        facts["pose"] = f"not connected to {name_html(fixed)}"
    else:
        facts |= _pose(f"in {name_html(fixed)}", placement.poses[row])
        parent = placement.rows.get(link.parent or "")
        if parent is not None and link.parent != fixed:
            relative = Transform.from_pose(placement.poses[parent]).inverse() @ Transform.from_pose(
                placement.poses[row]
            )
            facts |= _pose(f"in {name_html(link.parent or '')}", np.array(relative.pose()))
    if velocity is not None:
        facts["velocity"] = f"{_numbers(velocity.linear)} m/s"
        facts["turning"] = f"{_numbers(np.degrees(velocity.angular), 1)} °/s"
    if isinstance(estimate, TransformException):
        facts["error now"] = f"no estimate: {html.escape(cut(printable(str(estimate)), 400))}"
    elif estimate is not None:
        facts["error now"] = bounds(estimate)
        if by := carried_on(estimate):
            facts["carried on"] = html.escape(by)
    rows = "".join(
        f"<tr><td style='padding-right:0.8em;opacity:0.6;vertical-align:top'>{label}</td>"
        f"<td>{value}</td></tr>"
        for label, value in facts.items()
    )
    faults = "".join(f"<br>{_finding(finding)}" for finding in findings)
    return block(f"<b>{name_html(link.name)}</b><table>{rows}</table>{faults}")


def status_html(
    links: Mapping[str, ViewedLink],
    placement: Placement,
    fixed: str,
    stale_after_s: float,
    time_ns: int,
    now_ns: int,
    left_out: int,
    trouble: str | None,
    followed: str | None,
) -> str:
    """What is shown, what is stale, and what is not shown."""
    lines = []
    if trouble is not None:
        lines.append(f"<b style='color:{_RED}'>{html.escape(trouble)}</b>")
    if not links:
        return block("<br>".join([*lines, EMPTY_HTML]))
    lines.append(when_html(time_ns, now_ns))
    moving = sum(link.age_s is not None for link in links.values())
    lines.append(f"{len(links):,} frames, {moving:,} moving")
    if followed is not None:
        lines.append(f"the camera follows {name_html(followed)}")
    if left_out:
        lines.append(f"{left_out:,} more frames are not shown (--max-frames)")
    stale = [link.name for link in links.values() if link.is_stale(stale_after_s)]
    if stale:
        lines.append(
            f"<span style='color:{_RED}'>{len(stale):,} stale (over {stale_after_s:g} s): "
            f"{_list(stale)}</span>"
        )
    awaited = [link.name for link in links.values() if link.is_awaited]
    if awaited:
        lines.append(f"{len(awaited):,} not yet: {_list(awaited)}")
    if placement.elsewhere:
        others = sum(placement.elsewhere.values())
        lines.append(
            f"{others:,} not connected to {name_html(fixed)}, below: "
            f"{_list([*placement.elsewhere])}"
        )
    return block("<br>".join(lines))


def when_html(time_ns: int, now_ns: int) -> str:
    """A time: its date, if it is of a clock, its seconds, and how long ago it was."""
    stamp = f"{seconds(time_ns)[:-6]} s"
    if time_ns < SIMULATED_NS or time_ns > _MAX_DATE_NS:
        return f"at {stamp}"
    date = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(time_ns // 10**9))
    ago_ns = now_ns - time_ns
    ago = f"<br>{age(ago_ns)} ago" if ago_ns >= _AGO_NS else ""
    return (
        f"{date}.{time_ns // 10**6 % 1000:03} UTC{ago}<br><span style='opacity:0.6'>{stamp}</span>"
    )


def findings_html(findings: Sequence[Finding] | None) -> str:
    """All faults; None: nothing was observed yet."""
    if findings is None:
        return block("Watching the tree ...")
    if not findings:
        return block("No faults. <code>zenoh-tf doctor</code> looks for the same.")
    lines = [f"<p>{_finding(finding, named=True)}</p>" for finding in findings[:_FAULTS]]
    if len(findings) > _FAULTS:
        lines.append(f"and {len(findings) - _FAULTS:,} more")
    return block("".join(lines))


def block(content: str) -> str:
    """HTML as an element of the panel."""
    return f"<div style='font-size:0.85em;padding:0.2em 1em 0.8em'>{content}</div>"


def name_html(name: str) -> str:
    """A name as HTML."""
    return html.escape(cut(printable(name), 60))


def _age(link: ViewedLink) -> str:
    if link.static:
        return "static: holds at all times"
    if link.age_s is None:
        return "-"
    if link.age_s < 0:
        return f"its first sample comes in {age(int(-link.age_s * 1e9))}"
    return age(int(link.age_s * 1e9))


def _pose(where: str, pose: NDArray[np.float64]) -> dict[str, str]:
    X = Transform.from_pose(pose)
    angles = np.degrees(X.rpy())
    return {
        where: f"{_numbers(X.translation)} m<br>rpy {_numbers(angles, 1)} °<br>"
        f"<span style='opacity:0.6'>xyzw {_numbers(X.rotation)}</span>"
    }


def _numbers(values: Sequence[float] | NDArray[np.float64], digits: int = 3) -> str:
    # Adding 0 makes no number -0.
    return ", ".join(f"{round(float(x), digits) + 0.0:.{digits}f}" for x in values)


def _finding(finding: Finding, *, named: bool = False) -> str:
    title = f"{finding.fault.id} {html.escape(finding.fault.title)}"
    subject = f"{name_html(finding.subject)}: " if named else ""
    evidence = html.escape(cut(printable(finding.evidence), 400))
    remedy = re.sub("`(.*?)`", r"<code>\1</code>", html.escape(finding.fault.remedy))
    return (
        f"<b style='color:{PURPLE}'>{title}</b><br>{subject}{evidence}"
        f"<br><span style='opacity:0.6'>{remedy}</span>"
    )


def _list(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED:,} more" if len(names) > _LISTED else ""
    return ", ".join(map(name_html, names[:_LISTED])) + more
