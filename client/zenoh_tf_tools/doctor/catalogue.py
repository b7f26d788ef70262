"""The catalogue of faults. ``python -m zenoh_tf_tools.doctor`` prints its page."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from zenoh_tf_tools.doctor import clocks, publishers, structure, values
from zenoh_tf_tools.doctor.causes import without_consequences
from zenoh_tf_tools.doctor.facts import TreeFacts
from zenoh_tf_tools.doctor.findings import Fault, Finding

CATALOGUE: Final = (
    Fault(
        "TF101",
        "two publishers of one frame",
        "Two authorities write the same link by turns, so lookups jump between two poses. Often an "
        "old driver still runs, or a simulator beside the robot. Or one has published it as "
        "static, and another one publishes it as moving, or below a parent of another tree: a "
        "calibration of a frame that a driver places already splits the tree.",
        "End one of them; `zenoh-tf authorities` and `zenoh-tf frame NAME` show them. A "
        "calibration belongs to the root of the camera's tree: the evidence has the link to "
        "publish instead, with its numbers if the links between are static. The "
        "server's `--one-authority-per-frame` refuses the second.",
        publishers.two_publishers,
    ),
    Fault(
        "TF102",
        "a frame that flips between parents",
        "The frame's parent changes to and fro, so a chain exists at some times only. Two "
        "publishers disagree where the frame hangs.",
        "Let one publisher own the link. If both poses are wanted, give one of them another name.",
        publishers.flip_flop,
    ),
    Fault(
        "TF103",
        "a static frame that is also published as dynamic",
        "Each switch between static and dynamic clears the link's history, so lookups at past "
        "times fail. One publisher writes the link as both; if two do, it is TF101.",
        "Publish the link as static or as dynamic. A link that never moves is better static.",
        publishers.static_and_dynamic,
    ),
    Fault(
        "TF104",
        "a link that has stopped",
        "No sample has come for 10 periods and a second at least, or for 10 s since its only one. "
        "Lookups at the present fail, and the latest common time of every chain over the link "
        "stands still.",
        "Restart its publisher, or find why its messages do not arrive. Publish a link that never "
        "moves as static, on /tf_static and not on /tf. `zenoh-tf explain` shows what a lookup "
        "over the link makes of it.",
        publishers.stopped,
    ),
    Fault(
        "TF105",
        "a link with gaps",
        "The samples of the link come with pauses of 10 periods and half a second at least. "
        "Lookups in a gap interpolate over it, and lookups at the present fail meanwhile. If all "
        "links pause at once, the fastest one stands for all. Pauses of all links in which the "
        "stamps stood still, as of a simulator, or after which the samples came late, are none.",
        "Look at the load of its publisher, at the network, and at the drops that `zenoh-tf "
        "authorities` counts. If all links paused, their publishers' machine, the server or the "
        "recorder did not run.",
        publishers.gaps,
    ),
    Fault(
        "TF106",
        "transforms that were refused",
        "Transforms of this authority are not stored: a number is not finite, a quaternion is not "
        "of length 1, a frame id is empty, a link would close a loop, or a limit is reached. The "
        "other transforms of its messages are stored.",
        "The evidence has the reasons of the last refusal, which name the frames. `zenoh-tf "
        "authorities --json` counts the transforms by reason.",
        publishers.refused,
    ),
    Fault(
        "TF107",
        "a link that is too slow for its chain",
        "Three lookups or more asked for a time before the link's sample had come, and failed. Or "
        "so many failed or waited for it, and on average asked for more than 0.1 s after its "
        "newest sample. The server counts lookups by query only: others fail in the reader's "
        "process. Whether or not anybody looks it up, a link is too slow whose samples come at "
        "2.5 Hz at most, if those of its chain come 20 times as often: lookups over both at the "
        "present wait or fail, and the latest common time of the chain is as old as its last "
        "sample.",
        "Publish the link more often, or as static if it never moves. Otherwise let the "
        "consumer wait (`timeout_s`), ask for the latest common time or for the newest sample "
        "of each link (`zenoh-tf latest`), or estimate the pose at the present "
        "(`zenoh-tf estimate`).",
        publishers.slow,
    ),
    Fault(
        "TF108",
        "a mirrored robot that is disconnected",
        "Nothing comes from the server of a robot whose tree is mirrored (`--mirror-of`). Lookups "
        "over its links answer with its last poses. A simulated clock stands still with them, so "
        "they do not look old.",
        "Check that the robot's server runs, and the network to it. `zenoh-tf stats` has how old "
        "each robot's state is, as robot_age_s.",
        publishers.lost_mirrors,
    ),
    Fault(
        "TF201",
        "a clock that is off",
        "The stamps of one computer do not fit those of the others, so lookups across them fail or "
        "join poses of different times. A filter that stamps ahead on purpose looks the same; "
        "corrections that are repeated, and mounts that never move, are not reported.",
        "Synchronise the clocks (chrony, PTP). A sensor that is 37 s off has TAI from PTP, and one "
        "that is 18 s off has GPS time: set its driver's offset to UTC. "
        "docs/explanation/clocks.md says how the offsets are measured.",
        clocks.skewed_clock,
    ),
    Fault(
        "TF202",
        "stamps from the future",
        "The newest sample is ahead of the clock. Lookups at the present work, but interpolate "
        "towards a pose that nobody has measured yet. Some localisations do so on purpose.",
        "Check the clock of its publisher, or lower its transform tolerance.",
        clocks.future_stamps,
    ),
    Fault(
        "TF203",
        "repeated stamps",
        "Samples come at stamps that the link has already, and the last one replaces the others. "
        "A clock stands still, one message arrives by two routes, or a publisher repeats itself.",
        "Send each sample once, with the time of its measurement.",
        clocks.repeated_stamps,
    ),
    Fault(
        "TF204",
        "transforms older than the cache",
        "They arrived later than the cache time after newer ones of the same link, and were "
        "dropped. A second publisher has another clock, or a recording is played again.",
        "Find their publisher in the `dropped` column of `zenoh-tf authorities`, which a recording "
        "does not have. If there is only one, its clock was set back: repair it, or let "
        "`--time-jump clear` begin again.",
        clocks.too_old,
    ),
    Fault(
        "TF205",
        "time was set back",
        "Stamps jumped back by more than the cache time, or went on far ahead, as of another "
        "clock, and the link's history was cleared. A simulator was reset, or a clock was "
        "corrected.",
        "Nothing, if that was meant. Else see docs/explanation/clocks.md.",
        clocks.time_jumps,
    ),
    Fault(
        "TF206",
        "a clock that drifts",
        "The stamps steadily gain on their arrivals, or fall behind them. The clock that they "
        "are from is not synchronised, or stamps are counted from a nominal rate.",
        "Synchronise the clock (chrony, PTP), and stamp each sample with the time of its "
        "measurement. The offset that there is now grows until then.",
        clocks.drift,
    ),
    Fault(
        "TF207",
        "stamps of another epoch",
        "Some links have stamps of the real clock, and this one of another, such as simulated "
        "time. No lookup joins them.",
        "Give all nodes one clock: set `use_sim_time` in all of them or in none, and end what a "
        "simulator or an old recording still publishes. Let the driver of a sensor that counts "
        "from its own start stamp with the host's clock, or synchronise it (PTP). A stamp of 1.8 s "
        "after 1970 is probably one in seconds: stamps are integer nanoseconds "
        "(`time.time_ns()`).",
        clocks.other_epoch,
    ),
    Fault(
        "TF208",
        "stamps that jitter",
        "The stamps are irregular, and how old they are on arrival varies by more than the "
        "samples are apart. So interpolation takes poses for times at which they were not "
        "measured.",
        "Stamp a sample where it is measured, with the sensor's own time if it has one, not "
        "after buffers and queues.",
        clocks.jitter,
    ),
    Fault(
        "TF209",
        "samples out of order",
        "Samples come after newer ones of the same link. A server sorts them in, but a lookup "
        "in between has seen a history without them.",
        "Send the samples of one link over one connection and from one thread, in the order of "
        "their stamps. If it was once, a clock was set back: let chrony step it before the drivers "
        "start, and slew it from then on.",
        clocks.backwards,
    ),
    Fault(
        "TF210",
        "samples in bursts",
        "Samples come together after pauses in which they were measured, so lookups at the "
        "present fail and then succeed.",
        "Send each sample when it is measured. Look for batching in the publisher, for power "
        "saving of the wireless network, and for a full queue.",
        clocks.bursts,
    ),
    Fault(
        "TF301",
        "trees that are not connected",
        "No lookup works between frames of different trees. A link is missing, or one of its two "
        "frames is misspelt.",
        "Publish the pose of the smaller tree's root in a frame of the other one. Independent "
        "robots on one server may stay apart: ignore this then.",
        structure.unconnected,
    ),
    Fault(
        "TF302",
        "names that differ by slashes or case",
        "They are different frames, though a person would confuse them.",
        "Choose one spelling, and remove the other frame with `zenoh-tf remove`.",
        structure.alike_names,
    ),
    Fault(
        "TF303",
        "a very deep tree",
        "Every link of a chain costs time, and its data may be missing. Often each "
        "pose, as of a trajectory, gets a name of its own.",
        "Hang the frames below a common parent, or keep poses that are no frames elsewhere.",
        structure.deep,
    ),
    Fault(
        "TF401",
        "quaternions that are not of length 1",
        "They are no rotations. Up to a hundredth off they are normalised, beyond that refused.",
        "Normalise them where they are made; a length of 0 often is a message that nobody filled.",
        values.not_unit,
    ),
    Fault(
        "TF402",
        "a static link that was replaced by another value",
        "A static value holds at all times, so with another one all past lookups change as "
        "well. Two publishers disagree about a calibration, or one that should be dynamic is "
        "sent as static. Equal values do no harm.",
        "Let one publisher own the value. `zenoh-tf frame NAME` shows who wrote it last; "
        "publish a link that moves as dynamic.",
        values.replaced,
    ),
    Fault(
        "TF403",
        "a pose that jumps",
        "One step is far beyond what the link does otherwise. A localisation has found itself "
        "elsewhere, a sensor gave a wrong pose, odometry was reset, or a driver of joints sent "
        "zeros between two measurements.",
        "Look at the publisher at that time. Hang corrections of a localisation above the "
        "odometry, as map to odom, so that odometry stays smooth.",
        values.jumps,
    ),
    Fault(
        "TF404",
        "a frozen pose under fresh stamps",
        "Samples keep coming, but their pose stopped from one to the next and has been the same "
        "to the last bit since, while other links move. The publisher repeats its last result.",
        "Restart what computes the pose, and let its publisher stop when it has no new result, "
        "so that lookups fail instead of returning an old pose.",
        values.frozen,
    ),
    Fault(
        "TF405",
        "millimetres for metres",
        "A length or a speed is about a thousand times what it can be. All lengths are metres.",
        "Divide by 1,000 where the pose is made, such as in the export of a CAD model or the "
        "driver of an arm.",
        values.millimetres,
    ),
    Fault(
        "TF406",
        "an optical frame with the axes of its parent",
        "Images have z forwards, x to the right and y down (REP 103); a body has x forwards. "
        "Without the rotation between them, points seen by the camera are beside the robot or "
        "above it.",
        "Publish the optical frame with rpy -90 0 -90 degrees in the camera's body frame.",
        values.optical,
    ),
    Fault(
        "TF407",
        "a mount that is not rigid",
        "A sensor that should be fixed to its parent moves by fractions of a millimetre to "
        "centimetres. The mount is loose, or a calibration is estimated over and over.",
        "Fix the mount, calibrate once, and publish the link as static.",
        values.wobbling,
    ),
)

_BY_ID: Final = {fault.id: fault for fault in CATALOGUE}


def diagnose(facts: TreeFacts, ignore: Collection[str] = ()) -> list[Finding]:
    """Return the faults in the facts about a tree, in the order of the catalogue, without those
    that are only consequences of others.

    Args:
        facts: What is known about the tree.
        ignore: Ids of faults that are not searched for.

    Raises:
        ValueError: An id is not in the catalogue.
    """
    for name in ignore:
        if name not in _BY_ID:
            raise ValueError(f"there is no fault {name!r}; docs/reference/doctor.md lists them")
    findings = [
        Finding(fault, subject, evidence)
        for fault in CATALOGUE
        for subject, evidence in fault.check(facts)
    ]
    # A consequence stays hidden if its cause is ignored.
    return [
        finding
        for finding in without_consequences(findings, facts)
        if finding.fault.id not in ignore
    ]
