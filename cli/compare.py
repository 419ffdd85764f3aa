"""`massprops compare`: a run or mesh against a CAD mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from massprops import compare
from massprops_cli.options import Force, argument, defaults, option
from massprops_cli.terminal import say, warn

D = defaults(compare)


def command(
    source: Annotated[Path, argument(compare, "source", "RUN_OR_MESH")],
    cad: Annotated[Path, argument(compare, "cad", "CAD")],
    out: Annotated[Path | None, option(compare, "out", "-o", "--out")] = D.out,
    free_scale: Annotated[bool | None, option(compare, "free_scale", "--free-scale/--fixed-scale")] = D.free_scale,
    cad_unit: Annotated[str, option(compare, "cad_unit")] = D.cad_unit,
    force: Force = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print compare.json to stdout and nothing else.")] = False,
) -> None:
    """Align a result with a CAD mesh, then measure the distances between the surfaces and the error of every quantity.

    Example: massprops compare runs/demo samples/spacecraft.stl -o runs/demo
    """
    import json

    from massprops.exchange.compare import compare

    found = compare(source, cad, out=out, free_scale=free_scale, cad_unit=cad_unit, force=force)
    if out is not None and (out / "run.yaml").is_file():
        from massprops.report import write_report

        write_report(out)
    for warning in found.warnings:
        warn(warning)
    say(json.dumps(found.document()) if json_output else comparison_table(found.document()))


def comparison_table(document: dict[str, Any]) -> str:
    """Quantities, then surface distances, for the terminal; what the run recommends stands first."""
    tables = {"mesh": document["rows"], "fused": document.get("fused")}
    chosen = document.get("recommended", "mesh")
    lines = []
    for source in sorted(tables, key=lambda name: name != chosen):
        if tables[source]:
            mark = " (recommended)" if source == chosen and all(tables.values()) else ""
            lines += [*_quantities(tables[source], TITLES[source] + mark), ""]
    return "\n".join(lines + _distances(document))


TITLES = {"mesh": "from the mesh", "fused": "from mesh and motion together"}


def _quantities(rows: list[dict[str, Any]], title: str) -> list[str]:
    from massprops.exchange.compare import quantity_label

    lines = [f"  {'quantity':<18}{'CAD':>13}{'ours':>13}{'error':>13}  {'unit':<8}{'90 % interval':<24}contains CAD"]
    lines.insert(0, f"{title}:")
    for row in rows:
        bounds, holds = row["interval_90"], {True: "yes", False: "NO", None: ""}[row["holds"]]
        between = f"[{bounds[0]:.5g}, {bounds[1]:.5g}]" if bounds else ""
        angle = row["unit"] == "deg"  # between two axes: neither side has a number of its own
        numbers = f"{'':>26}" if angle else f"{row['cad']:>13.6g}{row['ours']:>13.6g}"
        unit = "" if angle else row["unit"].replace("1", "")
        lines.append(
            f"  {quantity_label(row['quantity']):<18}{numbers}{row['error_text']:>13}  {unit:<8}{between:<24}{holds}".rstrip()
        )
    lines.append(
        "  (errors of the centre of mass are in % of the greatest length, of I_xy, I_xz, I_yz in % of the mean moment)"
    )
    return lines


def _distances(document: dict[str, Any]) -> list[str]:
    d = document["distances"]
    lines = [f"  {'surface distance [mm]':<24}{'ours to CAD':>13}{'':>11}{'CAD to ours':>13}   (% of the length)"]
    names = {"median": "median", "mean_signed": "mean, signed", "rms": "rms", "p95": "95 %", "hausdorff": "Hausdorff"}
    for key, name in names.items():
        cells = "".join(f"{1000 * d[s][key]:>13.4g}{100 * d[s][key] / d['length']:>9.3f} %" for s in ("ours", "cad"))
        lines.append(f"  {name:<24}{cells}")
    lines.append(f"  greatest length of the CAD {d['length']:.6g} m; a positive distance means that ours lies outside")
    lines.append(f"  scale {'fitted' if document['free_scale'] else 'kept'}: {document['scale']:.6g}")
    return lines
