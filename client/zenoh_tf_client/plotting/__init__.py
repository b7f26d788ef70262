"""``zenoh-tf plot``: one pair of frames over time (`pair.py`), as a figure (`figure.py`)."""
