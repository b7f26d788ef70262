"""The session of an asynchronous client: sends requests from an event loop.

In comes a `Request`; out goes an awaitable of its result. `outbox` collects the calls of one turn
of the loop, `joining` makes few messages of them, `LoopSteps` takes the steps of the synchronous
client's `exchange`, and `transport` sends queries and hands their replies over from Zenoh's threads
(`wake`). `waits` cancels lookups that wait at the server.

It may import `session` and `requests` of the synchronous client, and nothing else of `aio`.
"""
