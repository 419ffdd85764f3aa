"""The way in: Ctrl-C while the command's modules are still being loaded is one line, too."""

from __future__ import annotations

import sys


def main() -> None:
    """Loads the command and runs it."""
    try:
        from massprops_cli.main import main as begin
    except KeyboardInterrupt:
        print("massprops: interrupted before anything was done", file=sys.stderr)
        sys.exit(130)
    begin()
