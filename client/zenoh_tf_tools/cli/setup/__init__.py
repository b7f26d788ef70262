"""Commands that prepare a robot or a site: `calibration`, `urdf`, `certificates`.

In come files that people keep (TOML, URDF); out go static links, the transforms of joints, and
certificates. The files without a command's name read and write these formats.
"""
