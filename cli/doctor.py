"""`massprops doctor`: what is installed, what is missing, and what to type."""

from __future__ import annotations

from typing import Annotated

import typer

from massprops_cli.terminal import say


def command(json_output: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False) -> int:
    """Check what is installed, and say what to type if something is missing.

    The exit code is 0 if everything is there, else 2.

    Example: massprops doctor
    """
    import json
    from dataclasses import asdict

    from massprops.run.doctor import examine

    findings = examine()
    if json_output:
        say(json.dumps([asdict(f) for f in findings]))
    else:
        for f in findings:
            say(f"  {'ok     ' if f.ok else 'MISSING'}  {f.name:<12} {f.detail}")
    return 0 if all(f.ok for f in findings) else 2
