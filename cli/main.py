"""The command `massprops`."""

from __future__ import annotations


def main() -> None:
    """Entry point."""
    raise SystemExit("massprops: no command yet")
