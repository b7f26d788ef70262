"""The types and docstrings of the native module, by subject; `_core.pyi` has the tree's, and names
all of them."""
