"""What a server process has once: its Zenoh session, its claim of the tree, the memory that
clients map, and the connection to another server that it copies.
"""
