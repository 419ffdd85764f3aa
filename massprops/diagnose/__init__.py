"""Where simulation and measurement disagree, which effect is missing, and the model with it."""

import sys as _sys
from types import ModuleType as _ModuleType
from typing import Any as _Any

from massprops.diagnose.diagnose import diagnose

__all__ = ["diagnose"]


class _Verb(_ModuleType):
    """Importing this package puts it in the place of the verb of the same name, so it answers as the verb does."""

    def __call__(self, *args: _Any, **kwargs: _Any) -> _Any:
        return diagnose(*args, **kwargs)


_sys.modules[__name__].__class__ = _Verb
