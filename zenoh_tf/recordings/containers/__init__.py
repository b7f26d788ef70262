"""The containers of recordings: MCAP, db3, ROS 1 bags, and what is compressed as a whole.

`opening.py` opens the files of a path as `Container`s, which yield raw messages in the order of
their log and note what is damaged. Nothing is decompressed beyond a bound that is known before.
"""
