"""`inspect.signature` of native functions, methods and classes.

nanobind keeps each signature as text, which is the stub's for every documented method, and gives
`inspect` nothing. Its types refuse assignments, so `install` puts the property into the
dictionaries behind them, which only the garbage collector hands out.
"""

from __future__ import annotations
import __future__

import gc
import inspect
import re
from typing import Any

from zenoh_tf._core import Transform, decoded_size


def _signature(function: Any) -> inspect.Signature:
    """The signature of a native function. AttributeError: its text is no Python."""
    text, _, defaults = function.__nb_signature__[0]
    text = re.sub(r"\\(\d+)", r"defaults[\1]", text) + ": ..."
    scope: dict[str, Any] = {"defaults": defaults}
    flags = __future__.annotations.compiler_flag  # names in annotations need not exist
    try:
        exec(compile(text, "<signature>", "exec", flags, dont_inherit=True), scope)
    except SyntaxError:  # types of arrays
        raise AttributeError("__signature__") from None
    return inspect.signature(scope[function.__name__])


def _bound_signature(method: Any) -> inspect.Signature:
    signature = _signature(method.__func__)
    return signature.replace(parameters=list(signature.parameters.values())[1:])


def install() -> None:
    """Let `inspect.signature` find the signatures of `_core`."""
    identity = Transform()
    for native, signature in [
        (decoded_size, _signature),
        (Transform.inverse, _signature),
        (identity.inverse, _bound_signature),
    ]:
        (namespace,) = gc.get_referents(type(native).__dict__)
        namespace["__signature__"] = property(signature)
