"""The one-file report of a campaign."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

from massprops.campaigns.boxes import box_plot
from massprops.campaigns.configuration import Plan
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.store import Store
from massprops.campaigns.table import HEAD, MOST_POINTS, Point, columns_of, left_out, percentile_rows
from massprops.campaigns.text import cell_text
from massprops.core.files import write_whole
from massprops.report.html import number, table, text
from massprops.report.page import of_sections

MOST_COLUMNS, MOST_FAILURES = 24, 100


def write_report(folder: Path, plan: Plan, points: list[Point], result: dict[str, Any], store: Store) -> Path:
    """Writes `report.html`: result, box plots, percentiles, failures, cost and configuration."""
    sections = [
        ("result", "Result", _result(result)),
        ("boxes", "Box plots", _boxes(plan, points)),
        ("percentiles", "Percentiles", _percentiles(plan, result)),
        ("failures", "Failures", _failures(points)),
        ("cost", "Cost", _cost(points, store)),
        ("configuration", "Configuration", f"<pre>{text(json.dumps(result['configuration'], indent=2))}</pre>"),
    ]
    path = folder / "report.html"
    write_whole(path, of_sections(f"massprops · campaign {plan.name}", sections, plan.where))
    return path


def _result(result: dict[str, Any]) -> str:
    done, failed = result["done"], result["failed"]
    points = str(len(result["points"]))
    tiles = [("runs", f"{done} of {result['runs']}"), ("failed", str(failed)), ("points of the grid", points)]
    parts = ['<div class="tiles">']
    parts += [f'<div class="tile"><span>{name}</span><div class="big">{value}</div></div>' for name, value in tiles]
    parts.append("</div>")
    if done < result["runs"]:
        parts.append('<div class="warning">This campaign is not finished: the same command continues it.</div>')
    for one_table in result["tables"]:
        rows = [[number(c, 3) if isinstance(c, float) else cell_text(c) for c in row] for row in one_table["rows"]]
        parts.append(f"<h3>{text(one_table['title'])}</h3>{table(rows, one_table['columns'])}")
        parts += [f'<p class="soft">{text(note)}</p>' for note in one_table.get("notes", ())]
    return "".join(parts)


def _boxes(plan: Plan, points: list[Point]) -> str:
    wanted = load_kind(plan.kind).boxes(plan)
    names = columns_of(points)
    names = [n for n in names if wanted is None or n in wanted][:MOST_COLUMNS]
    plots = []
    for name in names:
        plot = box_plot([(p.label, p.values(name)) for p in points[:MOST_POINTS]], name)
        if plot:
            plots.append(f"<div><h3>{text(_title(plan, name))}</h3>{plot}</div>")
    if not plots:
        return ""
    note = "Box: 25 to 75 %, line: median, whiskers: 5 and 95 %, dots: runs outside them. Failed runs are left out."
    return f'<p class="soft">{note}</p><div class="two">{"".join(plots)}</div>'


def _title(plan: Plan, column: str) -> str:
    """A column in words, where its kind has some."""
    return str(getattr(load_kind(plan.kind), "TITLES", {}).get(column, column.replace("_", " ")))


def _percentiles(plan: Plan, result: dict[str, Any]) -> str:
    parts = []
    for name, rows in islice(percentile_rows(result), MOST_COLUMNS):
        title = f"{text(_title(plan, name))} <code>{text(name)}</code>"
        shown = table([(*row[:3], *(number(v, 4) for v in row[3:])) for row in rows], HEAD)
        parts.append(f"<details><summary>{title}</summary>{shown}</details>")
    if note := left_out(result):
        parts.append(f'<p class="soft">{note}</p>')
    return "".join(parts)


def _failures(points: list[Point]) -> str:
    failed = [(p.label, r.seed, r.error) for p in points for r in p.rows if r.error is not None]
    if not failed:
        return ""
    more = f'<p class="soft">The first {MOST_FAILURES} of {len(failed)}.</p>' if len(failed) > MOST_FAILURES else ""
    note = '<p class="soft">Any run can be made again alone: massprops campaign CONFIG --only SEED</p>'
    return note + table(failed[:MOST_FAILURES], ("point", "seed", "error"), numeric=(1,)) + more


def _cost(points: list[Point], store: Store) -> str:
    spent, hosts = (
        [r.cpu_s for p in points for r in p.rows],
        {r.worker.rsplit(":", 1)[0] for p in points for r in p.rows},
    )
    each = sum(spent) / max(1, len(spent))
    rows = [
        ("processor time", f"{number(sum(spent), 4)} s, {number(1e3 * each, 3)} ms a run"),
        ("computers", str(len(hosts))),
    ]
    parts = [table(rows, numeric=())]
    lines = [
        (begun, place, ", ".join(f"{k} {v}" for k, v in versions.items()), count)
        for begun, place, versions, count in store.sessions()
    ]
    if len({line[2] for line in lines if line[3]}) > 1:
        parts.append('<div class="warning">The runs were made with more than one version of the code.</div>')
    parts.append(table(lines, ("begun", "where", "versions", "runs"), numeric=(3,)))
    return "".join(parts)
