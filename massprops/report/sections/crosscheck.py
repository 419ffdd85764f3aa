"""Shape against motion, when `massprops crosscheck` was run."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.mass.recommended import quantities
from massprops.report.curves import OWN, method_style
from massprops.report.data import RunData
from massprops.report.html import between, number, table, text
from massprops.report.meshes import Shape, decimated
from massprops.report.plot import plot
from massprops.report.ratio_plane import ratio_plane
from massprops.report.viewer import viewer

MOST_FACES = 8000
"""Of the mesh under the axes, which is shown a second time."""
TITLE, ORDER = "Shape against motion", 5
MEANING = {
    "consistent": "Mesh and motion agree within their uncertainties.",
    "inconsistent": "Mesh and motion disagree: the density is not constant, or one of the two is wrong.",
    "unobservable": "The motion does not show the inertia ratios, so nothing can be said.",
}


def render(data: RunData) -> str:
    """Verdict, the plane of k1 and k2, and the table of estimators."""
    document = data.crosscheck
    mesh, estimators = document.get("mesh") or {}, document.get("estimators") or []
    if not document.get("verdict"):
        return ""
    verdict = str(document["verdict"])
    kind = "done" if verdict == "consistent" else "warning"
    p = document.get("p_value")
    sentence = f"<b>{text(verdict)}</b>. {text(document.get('reason') or MEANING.get(verdict, ''))}"
    parts = [f'<div class="{kind}">{sentence}{f" (p = {number(p, 2)})" if p is not None else ""}</div>']
    rows = [("mesh", _value(mesh, "k1"), _value(mesh, "k2"), "", "", "")]
    for e in estimators:
        angle, sigma = e.get("axis_misalignment_deg"), e.get("sigma_axis_deg")
        shown = "–" if angle is None else f"{number(angle, 3)}°" + ("" if sigma is None else f" ± {number(sigma, 2)}°")
        yes = {True: "yes", False: "no"}
        rows.append(
            (
                str(e.get("name", "")),
                _value(e, "k1"),
                _value(e, "k2"),
                shown,
                yes.get(e.get("converged"), "–"),
                yes.get(e.get("observable"), "–"),
            )
        )
    head = ("method", "k1 (± 1σ)", "k2 (± 1σ)", "axes differ by", "converged", "observable")
    parts += [f'<p class="soft">Another explanation: {text(hint)}.</p>' for hint in (document.get("hints") or [])[1:]]
    parts.append(
        f'<div class="narrow">{ratio_plane(mesh, estimators, str(document.get("rests_on") or ""))}</div>{table(rows, head)}'
    )
    parts += [
        f'<p class="soft">{text(s.get("name"))} was not run: {text(s.get("reason"))}.</p>'
        for s in document.get("skipped") or []
    ]
    parts.append(_together(data))
    parts.append(_axes(data))
    parts.append(_residuals(document.get("residuals") or {}, str(document.get("rests_on") or "")))
    return "".join(parts)


def _together(data: RunData) -> str:
    """Mass properties by the mesh alone and by mesh and motion together."""
    fused, plain = data.crosscheck.get("fused"), data.document
    if not fused or not plain:
        return ""
    one, both = quantities(plain), quantities({"mass": plain["mass"], "center_of_mass": [], **fused})
    shown = [
        (name, number(one[name][0]), between(one[name][1], 4), number(both[name][0]), between(both[name][1], 4))
        for name in ("volume", "I1", "I2", "I3", "k1", "k2")
    ]
    return (
        "<h3>Mesh and motion together</h3>"
        + table(shown, ("", "mesh alone", "90 % interval", "together", "90 % interval"))
        + '<p class="soft">The motion corrects the mesh within its uncertainty, mostly where nothing was measured. '
        + f"Method: {text(fused.get('with'))}.</p>{_recommended(plain)}"
    )


def _recommended(document: dict[str, Any]) -> str:
    """Which of the two the run recommends, and why."""
    block = document.get("recommended") or {}
    because = str(block.get("because") or "")
    return f"<p><b>Recommended, and used in every export</b>: the values {text(because)}.</p>" if because else ""


def _axes(data: RunData) -> str:
    """Principal axes by the mesh and by the motion, on the mesh."""
    document, shape = data.crosscheck, data.shape
    name = document.get("rests_on")
    motion_estimates = [
        e for e in document.get("estimators") or [] if e.get("name") == name and e.get("principal_axes")
    ]
    listed_axes = (document.get("mesh") or {}).get("principal_axes")
    if shape is None or not motion_estimates or not listed_axes:
        return ""
    mesh_axes, motion = np.array(listed_axes, float), np.array(motion_estimates[0]["principal_axes"], float)
    # an axis has no sense of direction: draw the motion's the same way round
    motion = motion * np.sign(np.sum(mesh_axes * motion, axis=0) + 1e-300)
    plain = decimated(Shape(shape.vertices, shape.faces, np.ones(len(shape.faces), bool)), MOST_FACES)
    return (
        "<h3>Principal axes on the mesh</h3>"
        + viewer(plain, centre=data.centre, axes=mesh_axes, others=motion)
        + '<p class="soft">Thick: from the mesh. Thin, dark and longer: from the '
        + f"motion ({text(name)}).</p>"
    )


def _residuals(series: dict[str, Any], method: str) -> str:
    """What the best free rotation leaves of the attitude history, with the mesh's inertia and with the motion's (by a method)."""
    if not series.get("times"):
        return ""
    times, curves, styles = np.array(series["times"], float), [], []
    for key, name, style in (
        ("mesh", "with the mesh's inertia", OWN),
        ("motion", "with the motion's inertia", method_style(method)),
    ):
        if series.get(key):
            size = np.linalg.norm(np.array(series[key]["turn_deg"], float), axis=1)
            curves.append((f"{name}: {number(series[key]['rms'], 3)} times the noise", times, size))
            styles.append(style)
    if series.get("noise_deg"):
        curves.append(("noise of the attitudes", times, np.array(series["noise_deg"], float)))
        styles.append("noise")
    drawn = plot(curves, "time [s]", "attitude residual [°]", styles=styles)
    return (
        f'<h3>Residuals over time</h3><div class="narrow">{drawn}</div><p class="soft">Difference between the attitudes '
        "in the footage and the best free rotation with each inertia. The inertia of the mesh is uncertain, so it may leave more "
        "than the noise; the verdict takes both uncertainties into account.</p>"
    )


def _value(entry: dict[str, Any], key: str) -> str:
    sigma = entry.get(f"sigma_{key}")
    return number(entry.get(key), 4) + (f" ± {number(sigma, 2)}" if sigma is not None else "")
