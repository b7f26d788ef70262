"""Commands that prepare a robot: `calibration` and `urdf`.

In come files that people keep (TOML, URDF); out go static links and the transforms of joints. The
files without a command's name read and write these formats.
"""
