"""Queries in, replies out: the threads that receive requests, the lanes where they wait, the
clients that are connected, and the outboxes from which replies go.

Comes in: Zenoh's queries. Goes out: replies' bytes.
It calls `requests`, and knows nothing of what a request means.
"""
