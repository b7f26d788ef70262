"""The session with a server: sends requests, and reads the server's memory on the same host.

In comes a `Request`; out goes its result. `exchange` decides what is sent and when it is sent
again, as steps: it takes them with blocking calls, `aio.session` on an event loop. `connection` is
an exchange over a Zenoh session. `mapped_tree` maps the server's tree, so that a lookup there sends
nothing.

It may import `requests`.
"""
