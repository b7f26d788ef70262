"""A pytest plugin of ``make mutants-client``: the client's exchange is the copy that cosmic-ray
mutates, so no other program sees a mutation.

A path entry would not do: the finder of an editable install comes before all paths.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import zenoh_tf_client

COPY = Path(__file__).resolve().parents[2] / "build/mutants-client/exchange.py"
NAME = f"{zenoh_tf_client.__name__}.session.exchange"

_spec = importlib.util.spec_from_file_location(NAME, COPY)
assert _spec is not None and _spec.loader is not None
_module = importlib.util.module_from_spec(_spec)
sys.modules[NAME] = _module
# Bytecode is known by size and second, which two mutations may share.
_writes_bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
_spec.loader.exec_module(_module)
sys.dont_write_bytecode = _writes_bytecode
