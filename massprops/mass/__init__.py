"""Volume, centre of mass, inertia, principal frame, and the interval each of them deserves."""

import sys as _sys
from types import ModuleType as _ModuleType
from typing import Any as _Any


class _Verb(_ModuleType):
    """Importing this package puts it in the place of the verb of the same name, so it answers as the verb does."""

    def __call__(self, *args: _Any, **kwargs: _Any) -> _Any:
        from massprops.run.from_mesh import mass

        return mass(*args, **kwargs)


_sys.modules[__name__].__class__ = _Verb
