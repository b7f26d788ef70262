"""The command line ``zenoh-tf``, a thin layer over ``TransformClient``.

`main` parses arguments and reports errors. Each command family has a file with an ``add``
function, which declares its arguments, and one function for each of its commands. The families are
in folders: `tree` asks and changes a tree, `show` displays it, `recordings` writes and reads files,
`setup` prepares a robot or a site. The files here are what the families share.

A family may import these files, the SDK and the tools' folders below, and no other family's
folder.
"""
