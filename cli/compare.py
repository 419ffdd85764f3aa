"""`massprops compare`: a run or mesh against a CAD mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def command(
    source: Annotated[Path, typer.Argument(metavar="RUN_OR_MESH", help="Run folder, or a mesh file.")],
    cad: Annotated[Path, typer.Argument(metavar="CAD", help="Closed mesh in metres: STL, OBJ, PLY, GLB or OFF.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for compare.json and the coloured mesh.")
    ] = None,
    free_scale: Annotated[
        bool | None,
        typer.Option("--free-scale/--fixed-scale", help="Fit the scale too; default: when the run has none."),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print compare.json on stdout and nothing else.")] = False,
) -> None:
    """Align with a CAD mesh, then measure surface distances and the errors of every mass property.

    Example: massprops compare runs/demo samples/spacecraft.stl -o runs/demo
    """
    import json

    from massprops.exchange.compare import compare, write_comparison

    found = compare(source, cad, free_scale=free_scale)
    if out is not None:
        write_comparison(found, out)
        if (out / "run.yaml").is_file():
            from massprops.report import write_report

            write_report(out)
    for warning in found.warnings:
        typer.echo(f"warning: {warning}", err=True)
    typer.echo(json.dumps(found.document()) if json_output else _table(found.document()))


def _table(document: dict[str, Any]) -> str:
    lines = [f"  {'quantity':<18}{'CAD':>14}{'ours':>14}  {'error':>12}  unit     90 % holds"]
    for row in document["rows"]:
        holds = {True: "yes", False: "NO", None: ""}[row["holds"]]
        lines.append(
            f"  {row['quantity']:<18}{row['cad']:>14.6g}{row['ours']:>14.6g}  {row['error_text']:>12}  {row['unit']:<8} {holds}"
        )
    d = document["distances"]
    for name, title in (("ours", "ours to CAD"), ("cad", "CAD to ours")):
        v = {k: f"{1000 * x:.3g} mm ({100 * x / d['length']:.3f} %)" for k, x in d[name].items()}
        lines.append(
            f"  {title}: median {v['median']}, mean signed {v['mean_signed']}, rms {v['rms']}, 95 % {v['p95']}, Hausdorff {v['hausdorff']}"
        )
    lines.append(f"  scale {'fitted' if document['free_scale'] else 'kept'}: {document['scale']:.6g}")
    return "\n".join(lines)
