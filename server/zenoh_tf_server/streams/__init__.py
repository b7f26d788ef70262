"""What mirrors follow: the tree's change log as messages, snapshots, and the part that a mirror
asks for.

Comes in: changes that the tree has logged, and what interests read of it. Goes out:
Zenoh messages, and replies to mirrors.
"""
