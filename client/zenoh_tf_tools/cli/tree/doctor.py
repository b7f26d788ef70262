"""``zenoh-tf doctor``: find the faults of a tree."""

from __future__ import annotations

import argparse
import textwrap

from zenoh_tf.text import printable
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands, add_duration
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.observations import observe
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.doctor import CATALOGUE, Finding, RecordedFacts, TreeFacts, diagnose
from zenoh_tf_tools.errors import FAULT_FOUND


def add(commands: Commands) -> None:
    doctor = commands.add(
        "doctor",
        _doctor,
        "find faults: two publishers, stopped links, clocks that are off",
        "Watch the samples of a tree for some seconds, or read a recording, and print each known "
        "fault that it has, with the evidence and what to do. Exit code 3 if there are any.",
        "zenoh-tf doctor",
        "zenoh-tf doctor --for 1s --ignore TF301",
        "zenoh-tf doctor --json",
        "zenoh-tf doctor drive.mcap",
    )
    recorded.add_optional_file(doctor)
    help_ = "how long to watch (default 2s); 0: judge only what the server has"
    add_duration(doctor, "--for", help_, 2.0)
    doctor.add_argument(
        "--ignore",
        metavar="ID",
        action="append",
        default=[],
        choices=[fault.id for fault in CATALOGUE],
        help="a fault not to search for, such as TF301; repeatable",
    )


def _doctor(args: argparse.Namespace) -> int:
    if args.file is not None:
        facts = _recorded(args)
    else:
        with connect(args) as tf:
            facts = observe(tf, args.for_s, args.timeout)
    findings = diagnose(facts, args.ignore)
    document = {
        "tree": args.tree if args.file is None else None,
        "file": None if args.file is None else str(args.file),
        "frames": len(facts.frames),
        "observed_s": round(facts.observed_s, 3),
        "findings": [finding.document() for finding in findings],
    }
    output.show(args, document, _text(findings, len(facts.frames)))
    return FAULT_FOUND if findings else 0


def _recorded(args: argparse.Namespace) -> TreeFacts:
    facts = RecordedFacts()
    with recorded.opened(args, mixed=True) as recording:
        with Progress(recording.message_count, "messages") as progress:
            for number, message in enumerate(recording.messages(), start=1):
                facts.add(message.log_ns, message.topic, message.static, message.rows)
                progress.to(number)
        recorded.warn(recording)
    return facts.facts()


def _text(findings: list[Finding], frames: int) -> str:
    if not findings:
        return f"no faults in {frames:,} frames"
    lines: list[str] = []
    for number, finding in enumerate(findings):
        fault = finding.fault
        if number == 0 or fault is not findings[number - 1].fault:
            lines += ["", output.paint("late", f"{fault.id}  {fault.title}")]
            lines += _wrapped(fault.explanation, "  ")
            lines += _wrapped(f"To do: {fault.remedy}", "  ")
        subject = output.paint("frame", printable(finding.subject))
        lines.append(f"  - {subject}: {printable(finding.evidence)}")
    count = "1 fault" if len(findings) == 1 else f"{len(findings):,} faults"
    return "\n".join([f"{count} in {frames:,} frames", *lines])


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, 98, initial_indent=indent, subsequent_indent=indent)
