"""Shape against motion: the mesh's inertia held against every estimator on the same footage."""

import sys as _sys
from types import ModuleType as _ModuleType
from typing import Any as _Any

from massprops.crosscheck.crosscheck import crosscheck

__all__ = ["crosscheck"]


class _Verb(_ModuleType):
    """Importing this package puts it in the place of the verb of the same name, so it answers as the verb does."""

    def __call__(self, *args: _Any, **kwargs: _Any) -> _Any:
        return crosscheck(*args, **kwargs)


_sys.modules[__name__].__class__ = _Verb
