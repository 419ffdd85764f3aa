"""Mass properties of an object from a video of it, and from the way it moves.

What the command line does, as functions: `reconstruct`, `estimate`, `crosscheck`, `diagnose`, `compare`, `export`,
`simulate`, `mass_properties`, `masks`, `campaign`, `reproduce`; and `sequence_from_arrays` for your own tracks,
attitudes or rates. Each imports what it needs when it is called, so that `import massprops` costs nothing.
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
    "reconstruct",
    "reproduce",
    "sequence_from_arrays",
    "simulate",
]

_prepare_numba_cache()
