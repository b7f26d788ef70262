"""What people start: the command ``zenoh-tf``, the viewer, plots, a recorder, a health check.

The folders: `cli` has the commands; `viewer`, `foxglove_bridge`, `plotting` and `recorder` show or
keep what a tree has, `urdf` makes one from a robot's description. `errors` is what all
of them share. ``python -m zenoh_tf_tools`` is the command, ``python -m zenoh_tf_tools.health``
the check for containers.

It may import the SDK, `zenoh_tf_client`, and the library, `zenoh_tf`. Neither imports anything
from here.
"""
