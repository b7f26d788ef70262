"""What a request means: its bytes become calls of the tree, and their results the reply's bytes.

Comes in: the bytes of a message, and a callback for the reply. Goes out: the reply's bytes.
It has no Zenoh, so tests call it directly. It commits through `state`, and shares with `ingest`
what both judge: stamps from the future, clocks and refusals.
"""
