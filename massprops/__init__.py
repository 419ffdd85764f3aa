"""Mass properties of an object from a video of it, and from the way it moves.

The verbs of the command line are functions of this package; each is imported when first used, so that
`import massprops` costs nothing.
"""

# pycolmap's extension exports its own zlib: the system's must be loaded before it, or the heap is corrupted.
import zlib as _zlib  # noqa: F401
from importlib import import_module as _import_module
from typing import Any as _Any

from massprops.native import prepare_numba_cache as _prepare_numba_cache

__version__ = "0.1.0"

_VERBS = {
    "reconstruct": "massprops.run.reconstruct.reconstruct",
    "mass_properties": "massprops.run.from_mesh.mass",
    "masks": "massprops.run.masks.masks",
    "estimate": "massprops.estimators.estimate.estimate",
    "compare": "massprops.exchange.compare.compare",
    "crosscheck": "massprops.consistency.crosscheck.crosscheck",
    "diagnose": "massprops.diagnosis.search.diagnose.diagnose",
    "export": "massprops.exchange.export.export",
    "simulate": "massprops.simulation.simulate.simulate",
}
__all__ = sorted(_VERBS)

_prepare_numba_cache()


def __getattr__(name: str) -> _Any:
    if name in _VERBS:
        module, _, function = _VERBS[name].rpartition(".")
        return getattr(_import_module(module), function)
    raise AttributeError(f"module 'massprops' has no attribute '{name}'")
