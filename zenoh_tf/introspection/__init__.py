"""What is known of frames, and why a lookup succeeds or fails.

Comes in: records of frames, from a tree, a server or a recording. Goes out: `FrameInfo` and its
siblings (`frame_info`), and an explanation (`explain`, `explanation`). May import `text`.
"""
