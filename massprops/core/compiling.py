"""Compiles functions that are written for plain Python, together with the functions they call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any


@cache
def compiled(entry: str, *modules: str, fastmath: bool = True, one_piece: bool = False) -> Callable[..., Any]:
    """The function `entry` of the last module, compiled by numba when first called and cached on disk.

    The functions of all the modules see each other's compiled form under their own names, so a module may import a
    function from another by name, but not call it through the module. Where two modules have a function, or a number, of
    one name, the later module's serves all: an update rule or a form of the inertia is a module that is added.

    Args:
        entry: name of the function that is called from Python.
        modules: full names, e.g. "massprops.dynamics.kernels", of all that it calls and of its own.
        fastmath: lets sums be reordered and fused (infinite and NaN values keep their meaning).
        one_piece: inlines all that the entry calls. A large loop of functions that are compiled one by one is other code
            when it comes from the cache, and its last digits differ between a first run and later ones; to compile it
            whole takes a third longer.

    Raises:
        ImportError: numba is not installed.
    """
    import numba

    loaded = [import_module(name) for name in modules]
    # numba checks a cached function against its own file only: the name tells apart the states of all the files, and of this
    files = [__file__, *(str(m.__file__) for m in loaded)]
    digest = sha256(b"".join(Path(f).read_bytes() for f in files)).hexdigest()[:8]
    scope: dict[str, Any] = {"__name__": modules[-1]}
    for module in loaded:
        scope |= {k: v for k, v in vars(module).items() if not k.startswith("__")}
    flags: Any = {"contract", "reassoc", "nsz"} if fastmath else False
    for module in loaded:
        for name, function in list(vars(module).items()):
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                copy = FunctionType(function.__code__, scope, name, function.__defaults__)
                copy.__qualname__ = f"{name}_{digest}"
                copy.__module__ = module.__name__
                inner = name != entry
                scope[name] = numba.njit(
                    copy,
                    cache=not (inner and one_piece),
                    fastmath=flags,
                    error_model="numpy",
                    forceinline=inner and one_piece,
                    no_cpython_wrapper=inner,
                    no_cfunc_wrapper=True,
                )
    entry_function: Callable[..., Any] = scope[entry]
    return entry_function
