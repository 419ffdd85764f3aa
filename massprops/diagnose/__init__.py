"""Where simulation and measurement disagree, which effect is missing, and the model with it."""

import sys as _sys

from massprops import _Verb
from massprops.diagnose.diagnose import diagnose

__all__ = ["diagnose"]

_sys.modules[__name__].__class__ = _Verb
