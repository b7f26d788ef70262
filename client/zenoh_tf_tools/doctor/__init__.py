"""Finds faults of a tree: two publishers of one frame, stopped links, clocks that are off.

`CATALOGUE` lists them by number; docs/reference/doctor.md is made from it. `diagnose` works on
plain facts, so it serves an embedded tree, a server's and a recording alike.
"""

from zenoh_tf_tools.doctor.catalogue import CATALOGUE, diagnose
from zenoh_tf_tools.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.findings import Fault, Finding
from zenoh_tf_tools.doctor.observation import Observation
from zenoh_tf_tools.doctor.recorded import RecordedFacts

__all__ = [
    "CATALOGUE",
    "Fault",
    "Finding",
    "LinkFacts",
    "Observation",
    "RecordedFacts",
    "TreeFacts",
    "diagnose",
]
