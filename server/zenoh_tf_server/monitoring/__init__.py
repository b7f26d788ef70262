"""What an operator sees of a running server: logs, metrics, health, and messages to systemd.

Comes in: a `RunningServer`. It changes nothing that is served.
"""
