"""Scenarios with known truth: a tumbling body before a still camera, or a camera that walks round a still object."""

import sys as _sys

from massprops import _Verb
from massprops.simulate.simulate import simulate

__all__ = ["simulate"]

_sys.modules[__name__].__class__ = _Verb
