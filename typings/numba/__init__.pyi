"""What we use of numba, for mypy: a compiled function keeps the signature that it has in Python."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

_Function = TypeVar("_Function", bound=Callable[..., Any])

@overload
def njit(function: _Function, /, **options: Any) -> _Function: ...
@overload
def njit(**options: Any) -> Callable[[_Function], _Function]: ...
def __getattr__(name: str) -> Any: ...
