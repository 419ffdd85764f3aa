"""`massprops compare`: a run or mesh against a CAD mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from massprops import compare
from massprops.core.text import table
from massprops_cli.options import Force, argument, as_json, defaults, option
from massprops_cli.terminal import say, warn

D = defaults(compare)


def command(
    source: Annotated[Path, argument(compare, "source", "RUN_OR_MESH")],
    cad: Annotated[Path, argument(compare, "cad", "CAD")],
    out: Annotated[Path | None, option(compare, "out", "-o", "--out")] = D.out,
    free_scale: Annotated[bool | None, option(compare, "free_scale", "--free-scale/--fixed-scale")] = D.free_scale,
    cad_unit: Annotated[str, option(compare, "cad_unit")] = D.cad_unit,
    force: Force = False,
    json_output: Annotated[bool, as_json("compare.json")] = False,
) -> None:
    """Align a result with a CAD mesh, then measure the distances between the surfaces and the error of every quantity.

    Example: massprops compare runs/demo samples/spacecraft.stl -o runs/demo
    """
    import json

    from massprops.exchange.compare import compare

    comparison = compare(source, cad, out=out, free_scale=free_scale, cad_unit=cad_unit, force=force)
    if out is not None and (out / "run.yaml").is_file():
        from massprops.report import write_report

        write_report(out)
    for warning in comparison.warnings:
        warn(warning)
    say(json.dumps(comparison.document()) if json_output else comparison_table(comparison.document()))


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

    listed = []
    for row in rows:
        bounds, holds = row["interval_90"], {True: "yes", False: "NO", None: ""}[row["holds"]]
        between = f"[{bounds[0]:.5g}, {bounds[1]:.5g}]" if bounds else ""
        angle = row["unit"] == "deg"  # between two axes: neither side has a number of its own
        numbers = ("", "") if angle else (f"{row['cad']:.6g}", f"{row['ours']:.6g}")
        unit = "" if angle else row["unit"].replace("1", "")
        listed.append((quantity_label(row["quantity"]), *numbers, row["error_text"], unit, between, holds))
    head = ("quantity", "CAD", "ours", "error", "unit", "90 % interval", "contains CAD")
    note = "(errors of the centre of mass are in % of the greatest length, of I_xy, I_xz, I_yz in % of the mean moment)"
    return [f"{title}:", *table(head, listed, left=(0, 4, 5, 6)), f"  {note}"]


def _distances(document: dict[str, Any]) -> list[str]:
    from massprops.exchange.compare import DISTANCES

    d, rows = document["distances"], []
    for key, name in DISTANCES.items():
        both = (d[side][key] for side in ("ours", "cad"))
        rows.append([name, *(text for v in both for text in (f"{1000 * v:.4g}", f"{100 * v / d['length']:.3f} %"))])
    lines = table(("surface distance [mm]", "ours to CAD", "of length", "CAD to ours", "of length"), rows)
    lines.append(f"  greatest length of the CAD {d['length']:.6g} m; a positive distance means that ours lies outside")
    lines.append(f"  scale {'fitted' if document['free_scale'] else 'kept'}: {document['scale']:.6g}")
    return lines
