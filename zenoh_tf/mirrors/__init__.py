"""A mirror: a copy of a server's tree in this process, kept by the server's stream.

Comes in: messages of the stream, and snapshots. Goes out: a `TransformTree`, and what it lacks.
Client and replica bring the session; it opens none.
"""
