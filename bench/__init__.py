"""Benchmarks: ``python -m bench`` prints one JSON document."""
