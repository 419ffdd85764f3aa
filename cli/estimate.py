"""`massprops estimate`: motion and inertia ratios from the tracks of a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from massprops_cli.terminal import say, tell, warn


def command(
    source: Annotated[Path, typer.Argument(metavar="SEQ_OR_RUN", help="Sequence folder, or a run folder.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for estimates.json, CSVs and report.html.")],
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method", help="Estimator, may be repeated: smoother, ekf, iekf, ukf, ukf-gp, range-ukf, …, or all."
        ),
    ] = None,
    prior: Annotated[
        Path | None, typer.Option("--prior", metavar="FILTER_YAML", help="What 'export --to filter' wrote.")
    ] = None,
    model: Annotated[
        Path | None, typer.Option("--model", metavar="MODEL_YAML", help="What 'diagnose' wrote; for the smoother.")
    ] = None,
    effect: Annotated[
        list[Path] | None,
        typer.Option("--effect", metavar="FILE", help="An effect file of your own, may be repeated."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that this command did not write; never an input.")
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print estimates.json on stdout and nothing else.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> int:
    """Run the online estimators on a sequence's tracks, and the smoother that they are measured against.

    Example: massprops estimate runs/demo --method smoother -o estimates/demo
    """
    import json

    from massprops.effect_file import with_effects
    from massprops.estimators.estimate import estimate_all, write_outcome
    from massprops.report.estimates import check_place
    from massprops_cli.progress import StageProgress

    given = (source, *(p for p in (prior, model) if p is not None))
    check_place(out, given, force)
    with with_effects(effect or []), StageProgress(quiet) as watch:
        outcome = estimate_all(
            source,
            method or ["all"],
            prior,
            lambda done, total, what: watch(what or "done", min(done, total - 1), total, 0, 0, ""),
            model,
        )
    write_outcome(outcome, out, source, given[1:], force)
    document = json.loads((out / "estimates.json").read_text())
    for warning in document["warnings"]:
        warn(warning)
    if document["reason"]:
        tell(f"massprops: {' '.join(document['reason'].split())}")
    if json_output:
        say(json.dumps(document))
    else:
        say(estimate_table(document))
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
        rate = f"{57.29577951308232 * e['rate']['speed_rad_s']:.4f}" if e["rate"] else "-"
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
        lines.append(f"  prior: {prior['verdict']}{p}; axes tied by {prior['frame']}")
    for name, error in (document.get("against_truth") or {}).items():
        said = ", ".join(f"{key} {value:.3g}" for key, value in error.items() if value is not None)
        lines.append(f"  {name} against truth: {said}")
    return "\n".join(lines)
