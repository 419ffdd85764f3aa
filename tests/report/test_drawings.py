"""Lines, tables and charts that the pages share."""

from __future__ import annotations

import numpy as np

from massprops.estimators.methods import own
from massprops.report.curves import COLOURS, method_style
from massprops.report.estimates import _bounded, _overlaid, _reliable, _unreliable
from massprops.report.html import mark, unit
from massprops.report.plot import log_plot, plot
from massprops.report.ratio_plane import ratio_plane
from massprops.report.sections.comparison import _sides


def test_a_line_ends_where_a_number_is_missing() -> None:
    x, y = np.arange(6.0), np.array([1.0, 2.0, np.nan, 3.0, np.nan, 4.0])
    drawn = plot([("a", x, y)], "t", "y").split("<polyline")[1:]
    points = [line.split('points="')[1].split('"')[0].split() for line in drawn]
    assert [len(p) for p in points] == [2, 2, 2]
    assert points[0][0] != points[0][1] and points[1][0] == points[1][1], "a lone number is a dot"


def test_a_logarithmic_scale_has_its_marks_and_leaves_out_what_has_no_logarithm() -> None:
    drawn = log_plot([("a", np.arange(4.0), np.array([0.0, 1.0, 10.0, 100.0]))], "t", "y")
    points = drawn.split('points="')[1].split('"')[0].split()
    heights = [float(p.split(",")[1]) for p in points]
    assert len(points) == 3 and abs(heights[0] - 2 * heights[1] + heights[2]) < 0.11
    assert all(f">{m}</text>" in drawn for m in ("1", "10", "100"))


def test_marks_have_no_zeros_that_say_nothing() -> None:
    assert [mark(v) for v in (-2e-5, 2.5e-5, 0.0, 2e4)] == ["−2×10⁻⁵", "2.5×10⁻⁵", "0", "20000"]


def test_units_are_raised() -> None:
    assert unit("s^-1") == "s⁻¹" and unit("rad s^-2") == "rad s⁻²" and unit("kg m^2") == "kg m²" and unit("1") == "1"


def test_methods_that_fail_alike_are_told_once() -> None:
    fine = {"name": "a", "converged": True, "observable": True, "reliable": True, "because": "", "reason": ""}
    two = [{**fine, "name": n, "reliable": False, "because": "too <small>"} for n in ("b", "c")]
    lost = {**fine, "name": "d", "converged": False, "reliable": False, "reason": "astray"}
    said = _unreliable([fine, *two, lost])
    assert "<b>b, c</b>: too &lt;small&gt;" in said and "<b>d</b>: astray" in said and said.count("<li>") == 2
    assert _unreliable([fine]) == ""
    assert [_reliable(e) for e in (fine, two[0], lost)] == ["yes", "no", "no: did not converge"]


def test_an_ellipse_within_reach_is_drawn_whole() -> None:
    def one(name: str, k1: float, sigma: float) -> dict:
        return {"name": name, "k1": k1, "k2": -0.2, "sigma_k1": sigma, "sigma_k2": sigma, "converged": True}

    page = ratio_plane({}, [one("smoother", -0.5, 0.01), one("ekf", -0.49, 0.015)], "smoother")
    inside = [
        p
        for p in page.split(f'<polygon class="ring {method_style("ekf")}"')[1]
        .split('points="')[1]
        .split('"')[0]
        .split()
    ]
    x = np.array([float(p.split(",")[0]) for p in inside])
    assert x.min() >= 62 and x.max() <= 470, "the second method's ellipse lies within the pane"


def test_a_comparison_shows_first_what_the_run_recommends() -> None:
    row = {"quantity": "volume", "error_text": "+1 %"}
    both = {"rows": [row], "fused": [row]}
    assert [key for key, _ in _sides({**both, "recommended": "fused"})] == ["fused", "rows"]
    assert [key for key, _ in _sides({**both, "recommended": "mesh"})] == ["rows", "fused"]
    assert [key for key, _ in _sides({"rows": [row], "fused": None, "recommended": "mesh"})] == ["rows"]


def test_a_method_has_one_colour_in_every_chart() -> None:
    styles = {name: method_style(name) for name in own()}
    assert len(set(styles.values())) == min(len(styles), COLOURS), "the methods are told apart"
    times, flat = np.arange(5.0), np.ones((5, 3))
    for name, style in styles.items():
        entry = {"name": name, "k1": -0.5, "k2": -0.2, "sigma_k1": 0.1, "sigma_k2": 0.1, "converged": True}
        plane = ratio_plane({}, [{**entry, "name": "another", "k1": -0.4}, entry])
        assert f'<span class="key {style}">{name}</span>' in plane
        beside = _overlaid("error", "", {"another": (times, 2 * flat), name: (times, flat)}, size=True)
        assert f'<span class="key {style}">{name}</span>' in beside and f'<polyline class="{style}"' in beside
        alone = _bounded("rate", name, times, flat, None)
        assert alone.count(f'<polyline class="{style} d') == 3


def test_methods_whose_curves_cover_each_other_share_one() -> None:
    times = np.arange(5.0)
    same = {"ukf": (times, np.ones((5, 1))), "ukf-gp": (times, np.ones((5, 1))), "ekf": (times, np.zeros((5, 1)))}
    drawn = _overlaid("k1", "", same, size=False)
    assert drawn.count("<polyline") == 2 and f'<span class="key {method_style("ukf")}">ukf, ukf-gp</span>' in drawn
