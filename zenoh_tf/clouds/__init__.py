"""Points of sensors: `points` moves them and takes the motion out of sweeps, `sweep_times` reads
when each was measured."""
