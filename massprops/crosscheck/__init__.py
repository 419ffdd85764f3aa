"""Shape against motion: the mesh's inertia held against every estimator on the same footage."""

import sys as _sys

from massprops import _Verb
from massprops.crosscheck.crosscheck import crosscheck

__all__ = ["crosscheck"]

_sys.modules[__name__].__class__ = _Verb
