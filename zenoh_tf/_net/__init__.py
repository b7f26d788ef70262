"""What client and server share of the network: keys, sessions, credentials, one query and its
reply, and the socket between processes of one host.

Comes in: endpoints, credentials, bytes of requests. Goes out: configurations of Zenoh, and bytes of
replies. It imports `wire`, and nothing of the tree but `shared_tree`, which it hands over.
"""
