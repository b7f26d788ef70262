"""What stands beside the scene: the controls, the figures, and the list of frames.

`panel.py` makes all of them, and is what the viewer's thread reads and writes; `clock.py` are the
controls of the time, `frame_list.py` draws what `frame_tree.py` finds, `figures.py` is the text.
"""
