"""The page of a diagnosis: the gap before and after, where it was, the candidates, the histories."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.diagnosis.page_parts import GAP, law, not_tried, notes, simulator, torque_plot, verdict, wheel
from massprops.diagnosis.page_parts import residuals as over_time
from massprops.diagnosis.search.body_picture import body_picture
from massprops.diagnosis.search.result import Diagnosis
from massprops.model.linearise import Residuals, residuals
from massprops.model.measurements import Measurements
from massprops.report.html import Safe, number, table, text
from massprops.report.page import of_sections
from massprops.report.plot import plot
from massprops.report.svg import dot, drawing, line, pane

BINS = 120
ARROWS = 14


def page(d: Diagnosis) -> str:
    """`report.html`, one file that opens offline."""
    return of_sections(
        "massprops · diagnosis",
        [
            ("verdict", "Verdict", verdict(d.document) + _hidden_mass(d.document)),
            ("law", "A law for the residuals", law(d.document)),
            ("simulator", "Your simulator", simulator(d.document)),
            ("gap", "Residuals before and after", _gap(d)),
            ("where", "Where", _where(d)),
            ("candidates", "Candidates", _candidates(d.document)),
            ("motion", "Momentum and energy", _motion(d)),
            ("torque", "Torque recovered without a model", _torque(d)),
            ("notes", "Notes", notes(d.document)),
        ],
    )


def _hidden_mass(doc: dict[str, Any]) -> str:
    """A point mass and a density gradient, side by side, where the density was found to be uneven."""
    if "hidden_mass" not in doc:
        return ""
    h = doc["hidden_mass"]
    rows = []
    for name, what, x, way in (
        ("point mass", "mass × distance²", h, "direction"),
        ("density gradient", "mass × shift of the centre²", h["gradient"], "direction"),
    ):
        direction = ", ".join(number(v, 3) for v in x[way])
        rows.append((name, f"({direction})", what, number(x["second_moment"], 3), f"{number(100 * x['left'], 3)} %"))
    head = ("mass that the uniform shape lacks", "direction, body axes", "size", "over the mean moment", "unexplained")
    return (
        table(rows, head, numeric=(3, 4))
        + f"<p>Explains more: {text(h['better'])}. Not known: {text(h['unknown'])}.</p>"
    )


def _gap(d: Diagnosis) -> str:
    gap = d.document["gap"]
    rows = [
        (part.replace("_", " "), number(gap[part]["before"], 4), number(gap[part]["after"], 4), "1")
        for part in ("fitted", "held_out")
    ]
    parts = [
        f"<p>{GAP}</p>",
        table(rows, ("data", "before", "after", "noise floor")),
    ]
    base, best = d.selection.base, d.selection.best or d.selection.base
    problem = d.case.problem
    predicted = (residuals(problem, d.case.held, s.fit.predicted) for s in (base, best))
    plots = []
    for what, lines_by_channel in (
        ("", _over_time(problem.times, d.case.fitted, base.fit.residuals, best.fit.residuals)),
        (" held out", _over_time(problem.times, d.case.held, *predicted)),
    ):
        plots += [f"<div>{over_time(lines, channel + what)}</div>" for channel, lines in lines_by_channel]
    parts.append(f'<div class="two">{"".join(plots)}</div>')
    return "".join(parts)


def _over_time(times: np.ndarray, m: Measurements, before: Residuals, after: Residuals) -> list[Any]:
    out = []
    for name, at, b, a in (
        ("tracks", m.seen.epoch, before.tracks, after.tracks),
        ("range", m.range_at, before.range[:, None], after.range[:, None]),
        ("rates", m.rate_at, before.rates, after.rates),
        ("attitude", m.attitude_at, before.attitude, after.attitude),
    ):
        if not len(at):
            continue
        edges = np.linspace(times[0], times[-1], min(BINS, max(4, len(np.unique(at)))) + 1)
        where = np.clip(np.searchsorted(edges, times[at], side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(where, minlength=len(edges) - 1)
        middle = 0.5 * (edges[1:] + edges[:-1])

        def rms(v: np.ndarray, where: np.ndarray = where, count: np.ndarray = count) -> np.ndarray:
            total = np.bincount(where, np.mean(np.minimum(v**2, 900.0), axis=1), minlength=len(count))
            return np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))

        out.append((name, [("before", middle, rms(b)), ("after", middle, rms(a))]))
    return out


def _where(d: Diagnosis) -> str:
    rows = []
    for w in d.document["where"]:
        place = (w.get("direction") or "").replace("-", "−")
        if "region" in w:
            place = "image {:.0f}–{:.0f} × {:.0f}–{:.0f} px".format(
                w["region"][0], w["region"][2], w["region"][1], w["region"][3]
            )
        if w["features"]:
            place = f"feature {w['features'][0]}"
        a, b = w["interval_s"]
        rows.append(
            (
                w["channel"],
                f"{number(a, 3)}–{number(b, 4)} s",
                place,
                number(w["z"], 3),
                number(w["size"], 3),
                number(w["bias"], 2),
            )
        )
    head = ("measured", "time", "place", "z", "rms / σ", "mean / σ")
    note = (
        "Where the model without the effect fails most. z: how far beyond chance, in standard deviations. rms / σ: size "
        "of the residuals over the noise. mean / σ: their mean, which is 0 if they lean no way. Places +x, −y, …: the "
        "features on that side of the body."
    )
    pictures = "".join(f"<div>{p}</div>" for p in (_arrows(d), _on_the_body(d)) if p)
    return f'<p class="soft">{note}</p>{table(rows, head, numeric=(3, 4, 5))}<div class="two">{pictures}</div>'


def _on_the_body(d: Diagnosis) -> str:
    base, best = d.selection.base, d.selection.best or d.selection.base
    fit, features = base.fit, d.case.problem.features
    return body_picture(fit.state.points, features, d.case.fitted, fit.residuals, best.fit.residuals, d.surface)


def _arrows(d: Diagnosis) -> str:
    """Mean residuals of cam0 on the image plane, before (red) and after (green)."""
    m = d.case.fitted
    of_camera = m.seen.camera == 0
    if of_camera.sum() < 50:
        return ""
    uv = m.uv[of_camera]
    low, high = np.percentile(uv, [0, 100], axis=0)
    cell = np.clip(((uv - low) / np.maximum(high - low, 1e-9) * ARROWS).astype(int), 0, ARROWS - 1)
    key = cell[:, 0] * ARROWS + cell[:, 1]
    count = np.bincount(key, minlength=ARROWS**2)
    base, best = d.selection.base, d.selection.best or d.selection.base
    means = []
    for s in (base, best):
        r = np.clip(s.fit.residuals.tracks[of_camera], -30, 30) * m.sigma[of_camera, None]
        means.append(
            np.stack([np.bincount(key, r[:, k], minlength=ARROWS**2) for k in range(2)], axis=1)
            / np.maximum(count, 1)[:, None]
        )
    longest = max(float(np.abs(means[0][count >= 5]).max(initial=0.0)), 1e-9)
    width, height = 560.0, 560.0 * float(high[1] - low[1]) / max(float(high[0] - low[0]), 1e-9)
    height = float(np.clip(height, 120, 700))
    side = np.array([width, height]) / ARROWS
    parts = [pane(0, 0, width, height)]
    for mean, colour in zip(means, ("#c0392b", "#27ae60"), strict=True):
        for k in np.flatnonzero(count >= 5):
            x, y = (np.array(divmod(int(k), ARROWS)) + 0.5) * side
            dx, dy = mean[k] / longest * 0.9 * side.min()
            parts.append(line(x, y, x + dx, y + dy, f'stroke="{colour}" stroke-width="2"'))
            parts.append(dot(x, y, 1.5, f'fill="{colour}"'))
    return (
        f"<p>Mean residuals on the image of cam0, before (red) and after (green). The longest line is {number(longest, 3)} px.</p>"
        + drawing(parts, (width, height), "mean residuals on the image plane of cam0", "plot")
    )


def _candidates(doc: dict[str, Any]) -> str:
    if not doc["candidates"]:
        return "<p>A free rigid body is enough, so no effect was tried.</p>" + not_tried(doc)
    rows = []
    for c in doc["candidates"]:
        why = f'<span class="below">implausible: {text(c["implausible"])}</span>' if c["implausible"] else ""
        numbers = (
            number(c["delta_bic"], 5),
            number(c["fitted"], 4),
            number(c["held_out"], 4),
            number(c["whiteness"], 3),
        )
        rows.append((Safe(text(c["name"]) + why), *numbers))
    note = (
        "BIC gained: by how much the Bayesian information criterion falls; large is good. Fitted, held out: residuals over "
        "the noise, of the data in the fit and of data that it has not seen. Correlation: of one residual with the next, "
        "in standard deviations; near 0 is good."
    )
    head = ("effects", "BIC gained", "fitted", "held out", "correlation")
    return f'<p class="soft">{note}</p>' + table(rows, head, numeric=(1, 2, 3, 4)) + not_tried(doc)


def _motion(d: Diagnosis) -> str:
    h = d.history
    if h is None:
        return ""
    series = [(f"H {a}", h["times"], h["momentum"][:, i]) for i, a in enumerate("xyz")]
    return (
        f"<p>Angular momentum changes by {number(100 * h['size_drift'], 3)} % in size and {number(h['direction_drift_deg'], 3)}° in "
        f"direction over the record, energy by {number(100 * h['energy_drift'], 3)} %, under the model chosen.</p>"
        + f'<div class="two"><div>{plot(series, "time [s]", "momentum, inertial axes")}</div>'
        + f"<div>{plot([('energy', h['times'], h['energy'])], 'time [s]', 'energy over that at the start')}</div></div>"
        + _rotor(d)
    )


def _rotor(d: Diagnosis) -> str:
    """The momentum history of a wheel, where one was named."""
    best = d.selection.best or d.selection.base
    if "internal-rotor" not in best.names:
        return ""
    history = rotor_history(d)
    assert history is not None
    return "<h3>Momentum of the wheel</h3>" + wheel(history[0], history[1])


def rotor_history(d: Diagnosis) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """times (n,), momentum along the wheel's axis (n,) [rad/s over the mean moment], and the axis (3,), or None."""
    best = d.selection.best or d.selection.base
    if "internal-rotor" not in best.names:
        return None
    model = best.fit.state.model
    effect = next(m for m in model.modules if m.NAME == "internal-rotor")
    t = d.case.problem.times
    p = [float(v) for v in model.value("internal-rotor")]
    h = np.stack(np.broadcast_arrays(*effect.internal(t, (), p)), axis=-1)
    axis = np.array(p[:3]) / max(float(np.linalg.norm(p[:3])), 1e-300)
    return t, h @ axis, axis


def _torque(d: Diagnosis) -> str:
    if d.torque is None:
        return ""
    t = d.torque
    period = "no single period" if t["period_s"] is None else f"a period of {number(t['period_s'], 3)} s"
    frame = "fixed neither in the body nor in space" if t["frame"] == "neither" else f"fixed in the {t['frame']}"
    rows = [(n, number(c["along"], 2), number(c["power_along"], 2)) for n, c in t["correlations"].items()]
    return (
        f"<p>Body torque over the mean moment that takes the residual from {number(t['before'], 3)} to {number(t['after'], 3)}: "
        f"{frame}, {period}.{' Grey: 90 % intervals.' if np.isfinite(t['sigma']).all() else ''}</p>"
        + torque_plot(t["times"], t["torque"], t["sigma"])
        + table(rows, ("direction", "correlation along", "share of power along"))
    )
