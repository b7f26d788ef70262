"""``zenoh-tf plot``: one pair of frames over time (`pair.py`), as a figure (`figure.py`).

In comes a live or recorded source of `viewer`; out goes a file with a picture. It may import
`viewer`. Only `figure.py` needs matplotlib.
"""
