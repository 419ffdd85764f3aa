"""What to say to a name that is not known: the nearest one that is."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from massprops.errors import InputError


def unknown(what: str, given: object, known: Iterable[str], where: str = "") -> InputError:
    """The error for an unknown name, with the nearest known one when there is one near, else all of them."""
    names = list(known)
    folded = {name.casefold(): name for name in names}
    near = difflib.get_close_matches(str(given).casefold(), list(folded), n=1, cutoff=0.5)
    hint = f"did you mean {folded[near[0]]!r}?" if near else f"there are {', '.join(names) or 'none'}"
    return InputError(f"{where + ': ' if where else ''}no {what} {str(given)!r}; {hint}")
