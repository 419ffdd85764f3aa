"""`massprops effects`: the catalogue of what can act on a body or its sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from massprops_cli.terminal import say, warn


def command(
    effect: Annotated[
        list[Path] | None,
        typer.Option(
            "--effect",
            metavar="FILE",
            help="A file with an effect of your own, to check and list as well; can be repeated.",
        ),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the list as JSON and nothing else.")] = False,
) -> int:
    """List the known effects: formula, parameters with units, and the data they need.

    An effect of your own is a Python file with NAME, SENTENCE, FORMULA, PARAMETERS, NEEDS and the functions by which it
    acts. 'simulate', 'estimate' and 'diagnose' read it with --effect.

    Example: massprops effects --effect my_effect.py
    """
    import json

    from massprops.effect_file import with_effects
    from massprops.effects import effects, refused

    with with_effects(effect or []):
        listed = [entry(module) for module in effects().values()]
    for name, why in refused().items():
        warn(f"effect {name} of an installed package cannot be used: {why}")
    if json_output:
        say(json.dumps(listed))
    else:
        say("\n".join([*(_lines(e) for e in listed), MEANING]))
    return 0


MOST_NAMED, FIRST_NAMED = 15, 5
"""Of more parameters than that only the first are named on the terminal."""
MEANING = (
    "Torques and momenta are divided by the body's mean moment of inertia, as motion alone shows only ratios. In the "
    "formulas w are the body rates and B is the magnetic field."
)


def entry(effect: Any) -> dict[str, Any]:
    """What an effect's file says of it."""
    from massprops.effects import changes_motion

    return {
        "name": effect.NAME,
        "acts_on": "motion" if changes_motion(effect) else "sensors",
        "sentence": effect.SENTENCE,
        "formula": getattr(effect, "FORMULA", ""),
        "note": getattr(effect, "NOTE", ""),
        "parameters": [{"name": q.name, "unit": q.unit, "kind": q.kind} for q in effect.PARAMETERS],
        "needs": list(effect.NEEDS),
        "file": effect.__file__,
    }


def _lines(e: dict[str, Any]) -> str:
    """A few lines for the terminal."""
    rows = [f"{e['name']}  ({e['acts_on']})", f"  {e['sentence']}"]
    if e["formula"]:
        rows.append(f"  {e['formula']}")
    if e["note"]:
        rows.append(f"  {e['note']}")
    named = [f"{q['name']} [{q['unit']}]" for q in e["parameters"]]
    if len(named) > MOST_NAMED:
        named = [*named[:FIRST_NAMED], "...", f"{named[-1]} ({len(named)} in all)"]
    rows.append("  " + ", ".join(named))
    if e["needs"]:
        rows.append(f"  needs {', '.join(e['needs'])}")
    return "\n".join(rows)
