"""Error messages for unknown names, with the nearest known one."""

from __future__ import annotations

from collections.abc import Iterable

from massprops.documents.fields import no_key
from massprops.errors import InputError


def unknown(what: str, given: object, known: Iterable[str], where: str = "") -> InputError:
    """The error for an unknown name, with the nearest known one when there is one near, else all of them."""
    return InputError(f"{where + ': ' if where else ''}{no_key(str(given), known, what)}")
