"""Copies of the server's tree in this process: lookups in them send no message.

In come the snapshot and the stream of commits, which the library's `MirrorFeed` asks `source` for;
out come lookups (`mirror`, `reads`), transactions whose reads are in the copy (`transaction`),
errors about frames that a mirror of a part does not have (`interest`), and the pose of a pair as
it changes (`watch`, `watching`).

It may import the client's `Transaction`, `publish`, `session` and `requests`.
"""
