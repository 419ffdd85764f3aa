"""`massprops crosscheck`: the mesh's inertia against every estimator on the same footage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from massprops import crosscheck
from massprops.core.text import table, with_sigma
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option
from massprops_cli.terminal import say, warn

D = defaults(crosscheck)


def command(
    run: Annotated[Path, argument(crosscheck, "run", "RUN")],
    sequence: Annotated[Path | None, option(crosscheck, "sequence", metavar="SEQ")] = D.sequence,
    method: Annotated[list[str] | None, option(crosscheck, "method")] = D.method,
    force: Force = False,
    json_output: Annotated[bool, as_json("crosscheck.json")] = False,
    quiet: Quiet = False,
) -> None:
    """Test whether mesh and motion agree on the inertia ratios and principal axes.

    The result is stored in the run, and shown in its report.

    Example: massprops crosscheck runs/demo
    """
    from massprops.consistency import crosscheck
    from massprops_cli.progress import StageProgress

    with StageProgress(quiet) as watch:
        cross_checked = crosscheck(
            run,
            sequence,
            method or ["all"],
            force=force,
            progress=lambda done, total, what: watch(what or "compare", min(done, total - 1), total, 0, 0, ""),
        )
    document = json.loads((run / "crosscheck.json").read_text())
    for warning in cross_checked.warnings:
        warn(warning)
    if json_output:
        say(json.dumps(document))
    else:
        say(crosscheck_table(document))
        say(f"report: {run / 'report.html'}")


def verdict_line(folder: Path) -> str:
    """What the cross-check of a run came to, for the end of other commands."""
    path = folder / "crosscheck.json"
    if not path.is_file():
        return f"shape against motion: not compared; for that, type: massprops crosscheck {folder}"
    return f"shape against motion: {_verdict(json.loads(path.read_text()))}"


def _verdict(document: dict[str, Any]) -> str:
    p = "" if document["p_value"] is None else f" (p = {document['p_value']:.2g})"
    return f"{document['verdict']}{p}: {document['reason']}"


def crosscheck_table(document: dict[str, Any]) -> str:
    """Mesh, estimators and verdict for the terminal."""

    def named(name: str, entry: dict[str, Any]) -> list[str]:
        return [name, *(with_sigma(entry.get(k), entry.get(f"sigma_{k}"), ".4f") for k in ("k1", "k2"))]

    rows: list[list[str] | str] = [named("mesh", document["mesh"])]
    for e in document["estimators"]:
        angle, sigma = e["axis_misalignment_deg"], e["sigma_axis_deg"]
        axes = "-" if angle is None else f"{angle:.2f}" + (f" ±{sigma:.2g}" if sigma is not None else "")
        p = "-" if e["p_value"] is None else f"{e['p_value']:.2g}"
        cpu = "-" if e["cpu_us_per_step"] is None else f"{e['cpu_us_per_step']:.0f}"
        rows.append([*named(e["name"], e), axes, p, cpu])
        if e["reason"]:
            rows.append(e["reason"])
    lines = table(("", "k1", "k2", "axes differ [deg]", "p", "us/step"), rows)
    lines += [f"  {s['name']} skipped: {s['reason']}" for s in document["skipped"]]
    for name, p in document["tests"].items():
        lines.append(f"  test of {name}: p = {p:.2g}")
    lines.append(_verdict(document))
    lines += [f"  or {hint}" for hint in document["hints"][1:]]
    fused = document.get("fused")
    if fused:
        lines.append("  mesh and motion together:")
        for i, bounds in enumerate(fused["interval_90"]["principal_moments"]):
            value = fused["principal_moments"][i]
            lines.append(f"    I{i + 1} {value:.6g}  90 % interval [{bounds[0]:.5g}, {bounds[1]:.5g}]")
    return "\n".join(lines)
