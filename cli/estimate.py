"""`massprops estimate`: motion and inertia ratios from tracks, attitudes or body rates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from massprops import estimate
from massprops_cli.options import Force, Quiet, argument, defaults, option
from massprops_cli.terminal import say, tell, warn

D = defaults(estimate)
DEGREES = 57.29577951308232


def command(
    source: Annotated[Path, argument(estimate, "source", "SEQ_OR_RUN")],
    out: Annotated[Path | None, option(estimate, "out", "-o", "--out")] = D.out,
    method: Annotated[list[str] | None, option(estimate, "method")] = D.method,
    prior: Annotated[Path | None, option(estimate, "prior", metavar="FILTER_YAML")] = D.prior,
    model: Annotated[Path | None, option(estimate, "model", metavar="MODEL_YAML")] = D.model,
    effect: Annotated[list[Path] | None, option(estimate, "effect", metavar="FILE")] = D.effect,
    force: Force = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print estimates.json to stdout and nothing else.")
    ] = False,
    quiet: Quiet = False,
) -> int:
    """Estimate the motion and the inertia ratios from tracks, attitudes or body rates.

    The result is printed. With -o it is also written to a folder, with all values over time and a report.

    Example: massprops estimate runs/demo --method smoother -o estimates/demo
    """
    import json

    from massprops.core.files import plain
    from massprops.effect_file import with_effects
    from massprops.estimators.documents import document as document_of
    from massprops.estimators.estimate import estimate_all
    from massprops.report.estimates import check_place, write_estimates
    from massprops_cli.progress import StageProgress

    given = (source, *(p for p in (prior, model) if p is not None))
    if out is not None:
        check_place(out, given, force)
    with with_effects(effect or []), StageProgress(quiet) as watch:
        outcome = estimate_all(
            source,
            method or ["all"],
            prior,
            lambda done, total, what: watch(what or "done", min(done, total - 1), total, 0, 0, ""),
            model,
        )
    if out is not None:
        write_estimates(outcome, out, source, given[1:], force)
        document = json.loads((out / "estimates.json").read_text())
    else:
        document = plain(document_of(outcome, str(source)))
    for warning in document["warnings"]:
        warn(warning)
    if document["reason"]:
        tell(f"massprops: {' '.join(document['reason'].split())}")
    if json_output:
        say(json.dumps(document))
    else:
        say(estimate_table(document))
        if out is not None:
            say(f"report: {out / 'report.html'}")
    return 3 if document["reason"] else 0


def estimate_table(document: dict[str, Any]) -> str:
    """One line an estimator, for the terminal."""

    def value(entry: dict[str, Any], key: str) -> str:
        if entry[key] is None:
            return "-"
        sigma = entry[f"sigma_{key}"]
        return f"{entry[key]:.5f}" + (f" ±{sigma:.1g}" if sigma is not None else "")

    yes = {True: "yes", False: "no"}
    lines = [
        f"  {'method':<20}{'k1':>19}{'k2':>19}{'rate [deg/s]':>14}  converged  observable  reliable{'us/step':>10}"
    ]
    for e in document["estimators"]:
        rate = f"{DEGREES * e['rate']['speed_rad_s']:.4f}" if e["rate"] else "-"
        cpu = f"{e['cpu_us_per_step']:.0f}" if e["cpu_us_per_step"] is not None else "-"
        lines.append(
            f"  {e['name']:<20}{value(e, 'k1'):>19}{value(e, 'k2'):>19}{rate:>14}  {yes[e['converged']]:<11}"
            f"{yes[e['observable']]:<12}{yes[bool(e.get('reliable'))]:<8}{cpu:>10}"
        )
        why = e.get("because") or e["reason"]
        if why:
            lines.append(f"  {'':<20}{why}")
    for s in document["skipped"]:
        lines.append(f"  {s['name']:<20}skipped: {s['reason']}")
    prior = document["prior"]
    if prior is not None:
        p = f", p = {prior['p_value']:.2g}" if prior["p_value"] is not None else ""
        lines.append(f"  prior: {prior['verdict']}{p}; axes from {prior['frame']}")
    return "\n".join(lines + _against_truth(document.get("against_truth") or {}))


ERRORS = (
    ("k1_error", "k1", 1.0),
    ("k2_error", "k2", 1.0),
    ("attitude_rms_rad", "attitude [deg]", DEGREES),
    ("rate_rms_rad_s", "rate [deg/s]", DEGREES),
    ("position_rms_m", "position [m]", 1.0),
    ("axes_error_deg", "axes [deg]", 1.0),
)
"""Errors against the truth: key of the document, title, and factor to the title's unit."""


def _against_truth(found: dict[str, dict[str, float | None]]) -> list[str]:
    """One line a method; nothing where there is no truth."""
    if not found:
        return []
    lines = [f"  {'error against the truth':<24}" + "".join(f"{title:>16}" for _, title, _ in ERRORS)]
    for name, error in found.items():
        shown = ("-" if (v := error.get(key)) is None else f"{factor * v:.3g}" for key, _, factor in ERRORS)
        lines.append(f"  {name:<24}" + "".join(f"{cell:>16}" for cell in shown))
    return lines
