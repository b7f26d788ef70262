"""``zenoh-tf view``: the tree in three dimensions, in a browser, drawn by the library viser.

    source                     poses                  what is drawn           browser
    live.py or recorded.py -> placement.py, trails.py -> scene.py, models.py -> viser
                                                         controls/, cameras.py

One thread does all of it: `viewer.py` asks the source 20 times a second for the links at a time,
computes each frame's pose in the fixed frame, and gives viser what has changed. Another one runs
the doctor (`findings.py`). `camera.py` and `labels.py` compute what fits in the window.

It may import the SDK, and of the tools `errors` and `urdf`.
"""
