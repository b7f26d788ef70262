"""``zenoh-tf plot``: pairs of frames over time, from a tree (`lookups.py`), as a figure
(`figure.py`).

In comes a live or recorded source of `viewer`; out goes a file with a picture. It may import
`viewer`. Only `figure.py` needs matplotlib.
"""
