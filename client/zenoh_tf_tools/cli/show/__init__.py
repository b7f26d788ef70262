"""Commands that display a tree: `monitor` and `top` in the terminal, `view` in a browser,
`foxglove` in the app, `plot` as a figure.

In comes a server or a recording; what is drawn is in the folders `viewer`, `foxglove_bridge` and
`plotting`. `rates` computes what the terminal shows.
"""
