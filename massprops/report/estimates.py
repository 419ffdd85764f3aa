"""The page of `massprops estimate`, and its files: all of them or none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.files import json_text, plain
from massprops.core.inputs import key_of_source
from massprops.core.outputs import Outputs, deliver
from massprops.errors import InputError
from massprops.estimators.documents import document, history_csv
from massprops.estimators.outcome import Outcome
from massprops.estimators.result import Estimate
from massprops.report.against_truth import Errors, errors, true_ratios
from massprops.report.curves import component_style, method_style
from massprops.report.data import read_json
from massprops.report.html import number, table, text
from massprops.report.page import of_sections
from massprops.report.plot import plot
from massprops.sequence.truth import Truth, read_truth

MOST_POINTS = 400
"""Points of a curve: more than a screen shows would only make the page heavy."""
AXES = "xyz"


OWNER = "estimate"


def check_place(folder: Path, inputs: tuple[Path, ...] = (), force: bool = False) -> None:
    """Refuses a folder that estimates cannot go to; called before the work is done.

    Raises:
        InputError: the folder holds a run, a sequence or somebody's files.
    """
    for mark, what in (("run.yaml", "a run"), ("tracks0", "a sequence"), ("cam0", "a sequence")):
        if (folder / mark).exists():
            raise InputError(f"{folder}: this folder holds {what}; choose another -o")
    Outputs(folder).check(OWNER, ["estimates.json", "report.html"], inputs, force)


def write_estimates(
    outcome: Outcome, folder: Path, source: Any = None, more: tuple[Path, ...] = (), force: bool = False
) -> Path:
    """Writes `estimates.json`, one CSV per estimator and `report.html`, all of them or none.

    Of an earlier `estimate` of the same data in the folder, the methods that did not run this time stay.

    Args:
        source: sequence or run folder; anything else is data in memory.
        more: further files that the estimates rest on.
        force: files in the folder that no `estimate` wrote may be replaced.

    Raises:
        InputError: as `check_place`, or the folder cannot be written.
    """
    source = source if isinstance(source, str | Path) else None
    inputs = more if source is None else (Path(source), *more)
    check_place(folder, inputs, force)
    truth = None if source is None else read_truth(source)
    errors_by_method = (
        {e.name: errors(e, outcome.problem, truth) for e in outcome.estimates} if truth is not None else {}
    )
    content = plain(document(outcome, "" if source is None else str(source)))
    content["against_truth"] = (
        None if truth is None else {n: v.summary() for n, v in errors_by_method.items() if v is not None}
    )
    key = None if source is None else key_of_source(_sequence_of(Path(source)), *more)
    kept = _with_earlier(content, folder, key)
    files: dict[str, str | bytes] = {
        f"{e.name}.csv": history_csv(e, outcome.problem) for e in outcome.estimates if len(e.times)
    }
    files["report.html"] = render(outcome, content, errors_by_method, truth)
    files["estimates.json"] = json_text(content)
    deliver(folder, OWNER, files, key, inputs, force, keep=kept)
    return folder / "report.html"


def write_together(content: dict[str, Any], folder: Path, inputs: tuple[Path, ...] = (), force: bool = False) -> Path:
    """Writes the `estimates.json` of several records of one body; gives the folder.

    Args:
        content: of `estimators.several`; inputs: records and other files that it rests on; force: as of `write_estimates`.

    Raises:
        InputError: as `check_place`, or the folder cannot be written.
    """
    check_place(folder, inputs, force)
    deliver(folder, OWNER, {"estimates.json": json_text(content)}, None, inputs, force)
    return folder


def _sequence_of(source: Path) -> Path:
    return source / "sequence" if (source / "sequence").is_dir() else source


def _with_earlier(content: dict[str, Any], folder: Path, key: str | None) -> list[str]:
    """Adds to a document what an earlier one in the folder says of other methods on the same data.

    Returns:
        the histories of those methods, which stay.
    """
    outputs = Outputs(folder)
    entry = outputs.files.get("estimates.json")
    if key is None or entry is None or entry["key"] != key or not outputs.intact("estimates.json"):
        return []
    before = read_json(folder / "estimates.json")
    new = {e["name"] for e in content["estimators"]} | {e["name"] for e in content["skipped"]}
    for part in ("estimators", "skipped"):
        content[part] += [e for e in before[part] if e["name"] not in new]
    earlier = [e for e in before["estimators"] if e["name"] not in new]
    if content["against_truth"] is not None:
        known = before.get("against_truth") or {}
        content["against_truth"] |= {e["name"]: known[e["name"]] for e in earlier if e["name"] in known}
    return [e["history"] for e in earlier if e["history"]]


def render(
    outcome: Outcome, content: dict[str, Any], found: dict[str, Errors | None], truth: Truth | None = None
) -> str:
    """The page as text."""
    first = _summary(outcome, content, truth) + _side_by_side(outcome, found)
    listed = [(e.name, _method(e, found.get(e.name))) for e in outcome.estimates]
    ran = {e.name for e in outcome.estimates}
    listed += [(e["name"], _earlier(e)) for e in content["estimators"] if e["name"] not in ran]
    shut = "".join(f"<details><summary>{text(name)}</summary>{inner}</details>" for name, inner in listed)
    parts = (("summary", "Estimators", first), ("methods", "One by one", shut))
    return of_sections("massprops · estimates", parts, content["source"])


def _side_by_side(outcome: Outcome, found: dict[str, Errors | None]) -> str:
    """Every method in one chart: sizes of the errors where truth exists, else the ratios as they settled."""
    degrees, charts = np.degrees(1.0), []
    known = {e.name: error for e in outcome.estimates if (error := found.get(e.name)) is not None}
    if known:
        charts.append(("attitude error", "°", {n: (r.times, r.attitude * degrees) for n, r in known.items()}))
        charts.append(("rate error", "°/s", {n: (r.times, r.w * degrees) for n, r in known.items()}))
        ratios = {n: (r.times, r.k_history) for n, r in known.items() if r.k_history is not None}
        charts.append(("error of k1, k2", "", ratios))
    else:
        histories = {e.name: (np.asarray(e.times), e.k_history) for e in outcome.estimates if e.k_history is not None}
        for j, name in enumerate(("k1", "k2")):
            charts.append((name, "", {n: (t, k[:, j : j + 1]) for n, (t, k) in histories.items()}))
    parts = [_overlaid(what, unit, curves, bool(known)) for what, unit, curves in charts if len(curves) > 1]
    return f'<h3>Side by side</h3><div class="two">{"".join(parts)}</div>' if parts else ""


def _overlaid(what: str, unit: str, curves: dict[str, tuple[np.ndarray, np.ndarray]], size: bool) -> str:
    """One curve a method, of sizes or of values; the height is that of the second half."""
    drawn: list[tuple[str, np.ndarray, np.ndarray]] = []
    styles: list[str] = []
    for name, (times, values) in curves.items():
        keep = thin(len(times))
        y = np.linalg.norm(values[keep], axis=1) if size else values[keep, 0]
        same = [i for i, (_, x, other) in enumerate(drawn) if _alike(x, times[keep]) and _alike(other, y)]
        if same:  # one curve with both names: the second would hide the first
            drawn[same[0]] = (f"{drawn[same[0]][0]}, {name}", *drawn[same[0]][1:])
            continue
        drawn.append((name, times[keep], y))
        styles.append(method_style(name))
    late = np.concatenate([y[len(y) // 2 :] for _, _, y in drawn])
    late = late[np.isfinite(late)]
    if not len(late):
        return ""
    low, high = float(late.min()), float(late.max())
    room = 0.5 * (high - low) + 1e-300
    clipped = [(name, x, np.clip(y, 0.0 if size else low - room, high + room)) for name, x, y in drawn]
    return f"<div>{plot(clipped, 'time [s]', what + (f' [{unit}]' if unit else ''), 560, 230, styles=styles)}</div>"


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two curves cover each other."""
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=1e-6, atol=1e-9, equal_nan=True))


def _summary(outcome: Outcome, content: dict[str, Any], truth: Truth | None) -> str:
    from massprops.report.ratio_plane import ratio_plane

    parts = [f'<div class="warning">{text(line)}</div>' for line in content["warnings"]]
    if content["reason"]:
        parts.insert(0, f'<div class="stopped">{text(content["reason"])}</div>')
    measured = content["measured"]
    counts = ", ".join(f"{count} {name}" for name, count in measured.items() if count)
    parts.append(f"<p>{content['epochs']} epochs over {number(content['seconds'], 4)} s: {text(counts)}.</p>")
    if (prior := content["prior"]) is not None:
        p = f", p = {number(prior['p_value'], 2)}" if prior["p_value"] is not None else ""
        judge = f" by {prior['reference']}" if prior["reference"] else ""
        parts.append(f"<p>Prior: <b>{text(prior['verdict'])}</b>{text(judge)}{p}.</p>")
    of_truth = content["against_truth"] or {}
    rows = [_row(e, None if truth is None else of_truth.get(e["name"]) or {}) for e in content["estimators"]]
    parts.append(table(rows, HEAD if truth is None else HEAD + HEAD_OF_TRUTH))
    if truth is not None:
        k = true_ratios(truth)
        if k is not None:
            parts.append(
                f'<p class="soft">Truth: k1 = {number(k[0], 5)}, k2 = {number(k[1], 5)}. Errors are root mean squares over the second half of the recording.</p>'
            )
    parts.append(_unreliable(content["estimators"]))
    if outcome.skipped:
        lines = "".join(f"<li>{text(n)}: {text(why)}</li>" for n, why in outcome.skipped.items())
        parts.append(f"<h3>Not run</h3><ul>{lines}</ul>")
    sound = [e for e in content["estimators"] if e["converged"] and e["observable"]]
    if sound:
        true = None if truth is None else true_ratios(truth)
        of_truth = {} if true is None else {"name": "truth", "k1": float(true[0]), "k2": float(true[1])}
        parts.append(f'<div class="narrow">{ratio_plane(of_truth, sound, "smoother")}</div>')
    return "".join(parts)


HEAD = [
    *(
        "method",
        "reliable",
        "k1 (± 1σ)",
        "k2 (± 1σ)",
        "rate [°/s]",
        "squared innovations, 1 expected",
        "processor time a step [µs]",
    )
]
HEAD_OF_TRUTH = ["k1 error", "k2 error", "attitude error, rms [°]", "rate error, rms [°/s]", "axes error [°]"]


def _reliable(e: dict[str, Any]) -> str:
    """Whether the numbers of a method may be used, in a word or two."""
    lacks = {"converged": "no: did not converge", "observable": "no: the motion does not show k1, k2", "reliable": "no"}
    return next((answer for name, answer in lacks.items() if not e.get(name)), "yes")


def _unreliable(estimators: list[dict[str, Any]]) -> str:
    """Why methods are not reliable, each reason once."""
    names: dict[str, list[str]] = {}
    for e in estimators:
        if why := e.get("because") or e["reason"]:
            names.setdefault(why, []).append(e["name"])
    lines = "".join(f"<li><b>{text(', '.join(who))}</b>: {text(why)}</li>" for why, who in names.items())
    return f"<h3>What speaks against single methods</h3><ul>{lines}</ul>" if lines else ""


def _row(e: dict[str, Any], error: dict[str, Any] | None) -> list[Any]:
    """One method's row; error: its errors against the truth, None where there is none."""
    row = [
        e["name"],
        _reliable(e),
        _with_sigma(e["k1"], e["sigma_k1"]),
        _with_sigma(e["k2"], e["sigma_k2"]),
        number(np.degrees(e["rate"]["speed_rad_s"]), 4) if e["rate"] else "–",
        number(e["innovation"], 3),
        number(e["cpu_us_per_step"], 3),
    ]
    if error is not None:
        row += [
            number(error.get("k1_error"), 2),
            number(error.get("k2_error"), 2),
            number(_deg(error.get("attitude_rms_rad")), 2),
            number(_deg(error.get("rate_rms_rad_s")), 2),
            number(error.get("axes_error_deg"), 2),
        ]
    return row


def _earlier(entry: dict[str, Any]) -> str:
    history = f"; its values over time are in {entry['history']}" if entry["history"] else ""
    return f'<p class="soft">{text(f"From an earlier command on the same data{history}.")}</p>'


def _deg(value: float | None) -> float | None:
    return None if value is None else float(np.degrees(value))


def _with_sigma(value: float | None, sigma: float | None) -> str:
    return "–" if value is None else number(value, 5) + (f" ± {number(sigma, 2)}" if sigma is not None else "")


def _method(e: Estimate, error: Errors | None) -> str:
    """Plots of one estimator: errors with 3-sigma bounds where truth exists, else states with theirs."""
    parts = [f'<div class="warning">{text(line)}</div>' for line in e.warnings]
    if e.because or e.reason:
        parts.append(f'<div class="warning">{text(e.because or e.reason)}</div>')
    facts = [f"{e.used} measurements used, {e.gated} rejected as outliers"] if e.used else []
    facts += [f"residuals {number(e.innovation, 3)} times their stated variance"] if e.innovation is not None else []
    if facts:
        parts.append(f'<p class="soft">{text("; ".join(facts))}.</p>')
    if error is not None:
        parts.append(_error_plots(e, error))
    elif len(e.times):
        parts.append(_state_plots(e))
    return "".join(parts)


def thin(n: int) -> np.ndarray:
    """Indices (k,) of at most `MOST_POINTS` of n points, ends kept."""
    return np.unique(np.linspace(0, n - 1, min(n, MOST_POINTS)).round().astype(int))


def _error_plots(e: Estimate, error: Errors) -> str:
    degrees = np.degrees(1.0)

    def turned(sigma: np.ndarray | None) -> np.ndarray | None:
        """Sigmas along the truth's axes, as far as sigmas without correlation can be turned."""
        return None if sigma is None else np.sqrt(np.maximum(sigma[error.at] ** 2 @ (error.turn**2).T, 0.0))

    parts = [
        _bounded(
            "attitude error [°]",
            e.name,
            error.times,
            error.attitude * degrees,
            _scaled(turned(e.sigma_attitude), degrees),
        ),
        _bounded("rate error [°/s]", e.name, error.times, error.w * degrees, _scaled(turned(e.sigma_w), degrees)),
    ]
    if error.position is not None:
        sigma = None if e.sigma_position is None else e.sigma_position[error.at]
        parts.append(_bounded("position error [m]", e.name, error.times, error.position, sigma))
    if error.k_history is not None:
        sigma = None if e.k_sigma_history is None else e.k_sigma_history[error.at]
        parts.append(_bounded("error of k1, k2", e.name, error.times, error.k_history, sigma, ("k1", "k2")))
    return f'<div class="two">{"".join(parts)}</div>'


def _state_plots(e: Estimate) -> str:
    degrees = np.degrees(1.0)
    parts, times = [], np.asarray(e.times)
    if e.w is not None:
        parts.append(_bounded("rate [°/s]", e.name, times, e.w * degrees, _scaled(e.sigma_w, degrees), about=True))
    if e.position is not None:
        parts.append(_bounded("position [m]", e.name, times, e.position, e.sigma_position, about=True))
    if e.k_history is not None:
        parts.append(_bounded("k1, k2", e.name, times, e.k_history, e.k_sigma_history, ("k1", "k2"), about=True))
    return f'<div class="two">{"".join(parts)}</div>'


def _scaled(values: np.ndarray | None, factor: float) -> np.ndarray | None:
    return None if values is None else factor * values


def _bounded(
    label: str,
    method: str,
    times: np.ndarray,
    values: np.ndarray,
    sigma: np.ndarray | None,
    names: tuple[str, ...] = tuple(AXES),
    about: bool = False,
) -> str:
    """One plot in the method's colour, a curve a column with its 3-sigma band.

    The band is about zero for errors, about the value for states (about).
    The plot's height is that of the second half: what a filter does before it settles would hide all else.
    """
    keep, half = thin(len(times)), len(values) // 2
    columns = range(min(values.shape[1], len(names)))
    bounded = sigma is not None and np.isfinite(sigma[:, : len(columns)]).all()
    three = None if sigma is None or not bounded else 3.0 * sigma
    reach = [values[half:, j] for j in columns]
    if three is not None:
        middle = values if about else np.zeros_like(values)
        reach += [(middle + side * three)[half:, j] for j in columns for side in (-1, 1)]
    every = np.concatenate(reach)
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    room = 1.0 * (high - low) + 1e-300

    def cut(y: np.ndarray) -> np.ndarray:
        return np.clip(y, low - room, high + room)

    series = [(names[j], times[keep], cut(values[keep, j])) for j in columns]
    bands = []
    if three is not None:
        for j in columns if about else [int(np.argmax(np.nanmax(three[half:], axis=0)))]:
            at = values[keep, j] if about else np.zeros(len(keep))
            bands.append((times[keep], cut(at - three[keep, j]), cut(at + three[keep, j])))
    colour = method_style(method)
    styles = [f"{colour} {component_style(j)}" for j in columns]
    note = "" if not bands else "band: 3σ" if about else "band: 3σ, of the widest"
    return f'<div>{plot(series, "time [s]", label, 560, 220, bands, styles)}<p class="soft">{note}</p></div>'
