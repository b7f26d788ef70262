"""What an operator sees of a running server: logs, metrics, health, and messages to systemd.

Comes in: a `Watched` server. It changes nothing that is served.
"""
