"""The session of a client with several endpoints: it continues at the next server or replica.

Zenoh itself connects again through its list of endpoints when a link breaks. What it does not see
in time is here: `link_watch` ends a link on which nothing answers, and returns to a better endpoint
that is served again. `queries` are those that it can end, and `exchange` sends what they asked once
more. `connection` is made of these, or is a plain one if there is one endpoint.

It may import `session` and `requests`.
"""
