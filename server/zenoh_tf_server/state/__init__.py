"""Commits that must outlive the server: static links, and the file that has them.

Comes in: commits and removals. Goes out: what was stored, and a number to wait until it is durable.
"""
