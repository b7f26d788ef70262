"""The simulated robot of the demo: how it moves, its sensors, and clients that watch it."""
