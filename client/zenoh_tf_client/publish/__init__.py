"""Transforms that are put without waiting for a reply, as sensors need it.

In come transforms; out go messages on the key of an authority. `Broadcaster` is what users have,
`publisher` the Zenoh publisher under it, and `announcer` sends
static transforms again to a server that has lost them.

It may import `session` and `requests`.
"""
