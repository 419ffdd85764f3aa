"""Checks that a request fits into memory before anything is computed."""

from __future__ import annotations

import resource
from functools import cache

from massprops.core.processes import memory_there_is
from massprops.errors import InputError

SHARE = 0.6
"""Of the machine's memory that one request may take: working copies and other programs need the rest."""


@cache
def machine_bytes() -> int:
    """Bytes of memory of this machine, or of the container or limit that this process runs under."""
    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    return min([memory_there_is() or 2**63, *(limit for limit in limits if limit != resource.RLIM_INFINITY)])


def refuse_beyond(needed: float, what: str, advice: str) -> None:
    """Stops before a request that does not fit.

    Args:
        needed: bytes.
        what: the request, with its size in the user's terms.
        advice: what to do.

    Raises:
        InputError: more than `SHARE` of the machine's memory.
    """
    if needed > SHARE * machine_bytes():
        raise InputError(
            f"{what} would take {needed / 1e9:.1f} GB of memory, and this machine has {machine_bytes() / 1e9:.1f} GB: {advice}"
        )
