"""The session with a server: sends requests, and reads the server's memory on the same host.

In comes a `Request`; out goes its result. Most reads are one query of `connection` and its reply.
For all else `exchange` decides as steps, without I/O, what is sent and when it is sent again;
`connection` runs these steps with blocking calls, `aio.session` on an event loop. `mapped_tree`
maps the server's tree, so that a lookup there sends nothing, and `shared_reads` asks the server
where that has no answer.

It may import `requests`.
"""
