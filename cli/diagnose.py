"""`massprops diagnose`: where simulation and measurement disagree, and what is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from massprops import diagnose
from massprops_cli.options import Force, Quiet, argument, defaults, option
from massprops_cli.terminal import say, warn

D = defaults(diagnose)


def command(
    source: Annotated[Path, argument(diagnose, "source", "SEQ_OR_RUN")],
    out: Annotated[Path | None, option(diagnose, "out", "-o", "--out")] = D.out,
    discover: Annotated[bool, option(diagnose, "discover", "--discover")] = D.discover,
    effect: Annotated[list[Path] | None, option(diagnose, "effect", metavar="FILE")] = D.effect,
    force: Force = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print diagnosis.json on stdout and nothing else.")
    ] = False,
    quiet: Quiet = False,
) -> int:
    """Find where a free rigid body's motion and the measurements disagree, and name the missing effect.

    The result is printed; -o keeps it, with the model, the residuals and a report.

    Example: massprops diagnose sequences/one -o diagnoses/one
    """
    import json

    from massprops.core.files import plain
    from massprops.diagnosis.search import diagnose
    from massprops.effect_file import with_effects
    from massprops_cli.progress import StageProgress

    with with_effects(effect or []), StageProgress(quiet) as watch:
        found = diagnose(source, out, lambda what, done, total: watch(what, 0, 1, done, total, ""), force, discover)
    document = found.document
    for warning in document["warnings"]:
        warn(warning)
    if json_output:
        say((out / "diagnosis.json").read_text() if out is not None else json.dumps(plain(document)))
    else:
        say(diagnosis_table(document))
        if out is not None:
            say(f"report: {out / 'report.html'}")
    return 0


def diagnosis_table(document: dict[str, Any]) -> str:
    """A few lines: verdict, effects with their parameters, the gap."""
    rows = [f"  verdict   {document['verdict']}: {document['reason']}"]
    for effect in document["effects"]:
        gain = effect["held_out_gain"]
        held = "nothing held out" if gain is None else f"held-out gain {gain:+.2f}"
        rows.append(f"  {effect['name']}  (BIC {effect['delta_bic']:+.0f}, {held})")
        for name, value in effect["parameters"].items():
            if value is None:
                rows.append(f"    {name:<14}{'not shown':>14}")
                continue
            rows.append(f"    {name:<14}{value:>14.5g} ± {effect['sigma'][name]:<10.2g} {effect['units'][name]}")
    if "law" in document:
        rows += _law_rows(document["law"])
    gap = document["gap"]
    rows.append(f"  {'residual / noise':<20}{'before':>10}{'after':>10}")
    for part in ("fitted", "held_out"):
        before, after = (gap[part][k] for k in ("before", "after"))
        shown = [f"{v:10.3f}" if v is not None and v == v else f"{'–':>10}" for v in (before, after)]
        rows.append(f"  {part.replace('_', ' '):<20}{shown[0]}{shown[1]}")
    for place in document["where"][:3]:
        what = place.get("direction") or (f"feature {place['features'][0]}" if place["features"] else "")
        a, b = place["interval_s"]
        rows.append(f"  worst: {place['channel']} {what} from {a:.4g} to {b:.4g} s, z {place['z']:.0f}")
    return "\n".join(rows)


def _law_rows(law: dict[str, Any]) -> list[str]:
    """The law that was discovered, term by term."""
    if law["formula"] is None:
        return [f"  law       none: {law['because']}"]
    rows = [f"  law       {law['formula']}" + ("" if law["stated"] else f"  (not stated: {law['because']})")]
    for t in law["terms"]:
        rows.append(
            f"    {t['coefficient']:>12.4g} ± {t['sigma']:<9.2g} {t['unit']:<10} {t['term']}, probability {t['probability']:.2f}"
        )
    held = law["held_out"]
    if held["after"] is not None:
        rows.append(f"    held out: {held['before']:.2f} of the noise without it, {held['after']:.2f} with it")
    return rows
