"""What only works around Zenoh. Each file names the issue that it waits for, or the sentence of the
documentation that it answers; `tests/zenoh/test_still_needed.py` fails where this version of Zenoh
needs it no more.

Comes in: Zenoh's sessions, and bytes to send. Goes out: the same, so that no thread blocks in
Zenoh, no program aborts at its end, and an error says why. It imports `_net`, and nothing of the
tree.
"""
