"""Robots described in URDF: which transforms their joints are, and how positions move them.

`Urdf` publishes a robot's links from positions of its joints. `reader` reads a file, `kinematics`
turns positions into transforms, `visuals` reads what its links look like. docs/how-to/urdf.md is
for users.
"""

from zenoh_tf.urdf.urdf import Urdf

__all__ = ["Urdf"]
