"""`massprops estimate`: motion and inertia ratios from tracks, attitudes or body rates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from massprops import estimate
from massprops.core.text import table, with_sigma
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option
from massprops_cli.terminal import say, tell, warn

D = defaults(estimate)
DEGREES = 57.29577951308232


def command(
    source: Annotated[Path, argument(estimate, "source", "SEQ_OR_RUN")],
    more: Annotated[list[Path] | None, argument(estimate, "more", "[MORE]...")] = None,
    out: Annotated[Path | None, option(estimate, "out", "-o", "--out")] = D.out,
    method: Annotated[list[str] | None, option(estimate, "method")] = D.method,
    prior: Annotated[Path | None, option(estimate, "prior", metavar="FILTER_YAML")] = D.prior,
    model: Annotated[Path | None, option(estimate, "model", metavar="MODEL_YAML")] = D.model,
    effect: Annotated[list[Path] | None, option(estimate, "effect", metavar="FILE")] = D.effect,
    force: Force = False,
    json_output: Annotated[bool, as_json("estimates.json")] = False,
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
    from massprops.estimators.several import estimate_several
    from massprops.report.estimates import check_place, write_estimates
    from massprops_cli.progress import StageProgress

    given = (source, *(more or []), *(p for p in (prior, model) if p is not None))
    if out is not None:
        check_place(out, given, force)
    methods = method or ["all"]
    with with_effects(effect or []), StageProgress(quiet) as watch:

        def progress(done: int, total: int, what: str) -> None:
            watch(what or "done", min(done, total - 1), total, 0, 0, "")

        if more:
            together, _ = estimate_several([source, *more], methods, prior, model, progress)
            return _told_several(together, out, given, force, json_output)
        outcome = estimate_all(source, methods, prior, progress, model)
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
        _printed(document, out)
    return 3 if document["reason"] else 0


def _printed(document: dict[str, Any], out: Path | None) -> None:
    say(estimate_table(document))
    if out is not None:
        say(f"report: {out / 'report.html'}")


def _told_several(
    found: dict[str, Any], out: Path | None, given: tuple[Path, ...], force: bool, json_output: bool
) -> int:
    """Several records of one body, printed, and kept in `estimates.json`."""
    import json

    from massprops.core.files import plain
    from massprops.report.estimates import write_together

    if out is not None:
        write_together(found, out, given, force)
    for warning in found["warnings"]:
        warn(warning)
    if json_output:
        say(json.dumps(plain(found)))
        return 0
    rows = [
        [
            e["name"],
            *(with_sigma(e[k], e[f"sigma_{k}"]) for k in ("k1", "k2")),
            str(len(e["records"])),
            f"{e['p_value']:.2g}",
        ]
        for e in found["estimators"]
    ]
    lines = table(("method", "k1", "k2", "records", "p of one body"), rows, left=(0,))
    for e in found["estimators"]:
        for effect, parameters in e["parameters"].items():
            for name, value in parameters.items():
                lines.append(f"  {e['name']}: {name} of {effect} {with_sigma(value, e['sigma'][effect][name], '.5g')}")
    say("\n".join(lines))
    return 0


def estimate_table(document: dict[str, Any]) -> str:
    """One line an estimator, for the terminal."""
    yes = {True: "yes", False: "no"}
    rows: list[list[str] | str] = []
    for e in document["estimators"]:
        rate = f"{DEGREES * e['rate']['speed_rad_s']:.4f}" if e["rate"] else "-"
        cpu = f"{e['cpu_us_per_step']:.0f}" if e["cpu_us_per_step"] is not None else "-"
        answers = [yes[bool(e.get(k))] for k in ("converged", "observable", "reliable")]
        ratios = [with_sigma(e[k], e[f"sigma_{k}"]) for k in ("k1", "k2")]
        rows.append([e["name"], *ratios, rate, *answers, cpu])
        why = e.get("because") or e["reason"]
        if why:
            rows.append(why)
    head = ("method", "k1", "k2", "rate [deg/s]", "converged", "observable", "reliable", "us/step")
    lines = table(head, rows, left=(0, 4, 5, 6))
    lines += [f"  {s['name']} skipped: {s['reason']}" for s in document["skipped"]]
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
    rows = [
        [name, *("-" if (v := error.get(key)) is None else f"{factor * v:.3g}" for key, _, factor in ERRORS)]
        for name, error in found.items()
    ]
    return table(("error against the truth", *(title for _, title, _ in ERRORS)), rows)
