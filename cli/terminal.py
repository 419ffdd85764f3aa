"""What the commands print: results on stdout, everything else on stderr, and nothing that a terminal would obey."""

from __future__ import annotations

import sys

from massprops.core.text import clean


def say(text: str) -> None:
    """A result, on stdout."""
    print(clean(text))


def warn(text: str) -> None:
    """A warning, on stderr."""
    tell(f"warning: {' '.join(text.split())}")


def tell(text: str) -> None:
    """A line for the user, on stderr."""
    print(clean(text), file=sys.stderr, flush=True)


def warn_of_density(assumed: bool) -> None:
    """That nobody gave the density, where nobody did: mass and moments follow it."""
    if assumed:
        warn("no --density given: 1000 kg/m^3 (water) is assumed; mass and moments of inertia depend on it")
