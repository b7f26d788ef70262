"""Robots described in URDF: which transforms their joints are, and how positions move them.

`reader` reads a file, `kinematics` turns positions into transforms, `joint_states` listens to a
robot, `visuals` reads what its links look like. docs/how-to/urdf.md is for users.

It may import the SDK, and nothing else of the tools.
"""
