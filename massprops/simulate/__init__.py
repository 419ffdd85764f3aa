"""Scenarios with known truth: a tumbling body before a still camera, or a camera that walks round a still object."""

import sys as _sys
from pathlib import Path as _Path
from types import ModuleType as _ModuleType
from typing import Any as _Any

from massprops.simulate.simulate import simulate

__all__ = ["simulate"]


class _Verb(_ModuleType):
    """Importing this package puts it in the place of the verb of the same name, so it answers as the verb does."""

    def __call__(self, *args: _Any, **kwargs: _Any) -> _Path:
        return simulate(*args, **kwargs)


_sys.modules[__name__].__class__ = _Verb
