"""Volume, centre of mass, inertia, principal frame, and the interval each of them deserves."""

import sys as _sys

from massprops import _Verb

_sys.modules[__name__].__class__ = _Verb
