"""Who may do what: keys and users, access rules, and the same as a configuration of Zenoh.

It imports no other folder of the server.
"""
