"""Mass properties of an object from a video of it, and from the way it moves.

The verbs of the command line are functions of this package; each is imported when first used, so that
`import massprops` costs nothing.
"""

# pycolmap's extension exports its own zlib: the system's must be loaded before it, or the heap is corrupted.
import zlib as _zlib  # noqa: F401
from importlib import import_module as _import_module
from types import ModuleType as _ModuleType
from typing import Any as _Any

from massprops.native import prepare_numba_cache as _prepare_numba_cache

__version__ = "0.1.0"

_VERBS = {
    "reconstruct": "massprops.run.reconstruct",
    "mass": "massprops.run.from_mesh",
    "masks": "massprops.run.masks",
    "estimate": "massprops.estimators",
    "compare": "massprops.exchange.compare",
    "crosscheck": "massprops.crosscheck",
    "diagnose": "massprops.diagnose",
    "export": "massprops.exchange.export",
    "simulate": "massprops.simulate",
}
__all__ = sorted(_VERBS)

_prepare_numba_cache()


class _Verb(_ModuleType):
    """A package of the name of a verb takes that verb's place once imported, so it answers as the verb does."""

    def __call__(self, *args: _Any, **kwargs: _Any) -> _Any:
        name = self.__name__.rpartition(".")[2]
        return getattr(_import_module(_VERBS[name]), name)(*args, **kwargs)


def __getattr__(name: str) -> _Any:
    if name in _VERBS:
        return getattr(_import_module(_VERBS[name]), name)
    raise AttributeError(f"module 'massprops' has no attribute '{name}'")
