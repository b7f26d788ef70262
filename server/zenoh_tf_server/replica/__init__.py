"""A server that nobody can write to: it serves a copy of another server's tree, its primary.

Comes in: the primary's stream, as to any mirror, and requests of clients. Goes out: replies with
their age, and the stream again.
"""
