"""Recordings of transforms: reads MCAP, rosbag2 and ROS 1 bags, and writes MCAP.

Needs the libraries of ``pip install 'zenoh-tf[recordings]'``. A recording has one reader,
`Recording`: for a tree (`zenoh_tf.TransformTree.from_recording`), and for `zenoh-tf query` and
`replay`. docs/how-to/recordings.md says which files can be read, and what is a static link.

    containers/ -> decoders.py, poses.py -> recording.py -> load.py
    raw messages   their rows               topics.py       a tree

`writer.py` makes a file.
"""

from __future__ import annotations

from .errors import RecordingError
from .load import MAX_MEMORY_BYTES, OPTIONS, load
from .recording import Message, Recording, open_recording

__all__ = [
    "MAX_MEMORY_BYTES",
    "OPTIONS",
    "Message",
    "Recording",
    "RecordingError",
    "load",
    "open_recording",
]
