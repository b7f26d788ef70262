"""The command line ``zenoh-tf``, a thin layer over ``TransformClient``.

``main`` parses arguments and reports errors. Each command family has a file with an ``add``
function, which declares its arguments, and one function for each of its commands.
"""
