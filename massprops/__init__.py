"""Measure the mass properties of an object from a video of it, and from the way it moves.

These functions do what the commands do: `reconstruct`, `estimate`, `crosscheck`, `diagnose`, `compare`, `export`,
`simulate`, `mass_properties`, `masks`, `campaign`, `reproduce`. `open_run` opens a run that was made earlier, and
`sequence_from_arrays` takes your own tracks, attitudes or rates. `import massprops` is fast, because each function
imports what it needs when it is called.
"""

# pycolmap's extension exports its own zlib: the system's must be loaded before it, or the heap is corrupted.
import zlib as _zlib  # noqa: F401

from massprops.api.verbs import (
    campaign,
    compare,
    crosscheck,
    diagnose,
    estimate,
    export,
    masks,
    mass_properties,
    open_run,
    reconstruct,
    reproduce,
    sequence_from_arrays,
    simulate,
)
from massprops.errors import InputError, MasspropsError, NotPossible
from massprops.native import prepare_numba_cache as _prepare_numba_cache

__version__ = "0.1.0"
__all__ = [
    "InputError",
    "MasspropsError",
    "NotPossible",
    "campaign",
    "compare",
    "crosscheck",
    "diagnose",
    "estimate",
    "export",
    "mass_properties",
    "masks",
    "open_run",
    "reconstruct",
    "reproduce",
    "sequence_from_arrays",
    "simulate",
]

_prepare_numba_cache()
