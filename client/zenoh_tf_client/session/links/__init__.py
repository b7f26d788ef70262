"""Zenoh sessions of a client, one at a time: at which of its endpoints, and until when."""
