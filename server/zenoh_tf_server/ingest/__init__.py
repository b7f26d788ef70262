"""Puts of sensors: from messages on keys to commits, fair between authorities, and what is refused.

Comes in: messages with their keys. Goes out: commits, and counters. A put has no answer.
"""
