"""The simulated robot of the demo: its motion, its sensors, and clients that observe it."""
