"""The command line ``zenoh-tf``: a thin shell over ``TransformClient``.

``main`` parses and reports errors; each command family has a file of its own, with an ``add``
function that declares its arguments and a ``run`` function for each of its commands.
"""
