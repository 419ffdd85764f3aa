"""Memory that a request would take, refused before it is taken."""

from __future__ import annotations

import os
import resource
from functools import cache
from pathlib import Path

from massprops.errors import InputError

SHARE = 0.6
"""Of the machine's memory that one request may take: working copies and other programs need the rest."""
CGROUP = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@cache
def machine_bytes() -> int:
    """Bytes of memory of this machine, or of the container or limit that this process runs under."""
    found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for place in CGROUP:
        try:
            found.append(int(Path(place).read_text()))
        except (OSError, ValueError):
            continue
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return min([*found, *([limit] if limit != resource.RLIM_INFINITY else [])])


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
            f"{what} would take {needed / 1e9:.1f} GB of memory, of {machine_bytes() / 1e9:.1f} GB here: {advice}"
        )
