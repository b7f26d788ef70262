"""A server that answers reads from a copy of another server's tree, its primary.

Comes in: the primary's stream, and requests of clients. Goes out: replies. Writes go to the
primary.
"""
