"""What holds of the small pieces of a page whatever they are given: nothing of outside is markup, numbers are right."""

from __future__ import annotations

from html.parser import HTMLParser

import numpy as np
from drawn import arrays, numbers, quickly
from hypothesis import assume, given
from hypothesis import strategies as st

from massprops.report import html, svg
from massprops.report.plot import log_plot, plot
from massprops.report.ratio_plane import ratio_plane


class Page(HTMLParser):
    """Which elements a piece holds, and its text."""

    def __init__(self, piece: str) -> None:
        super().__init__()
        self.elements: list[str] = []
        self.said = ""
        self.feed(piece)
        self.close()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.elements.append(tag)

    def handle_data(self, data: str) -> None:
        self.said += data


OUTSIDE = st.text(max_size=30) | st.sampled_from(["<script>alert(1)</script>", '"><img src=x>', "&lt;b&gt;", "]]>"])


@quickly
@given(OUTSIDE)
def test_text_from_outside_is_shown_and_is_no_markup(said: str) -> None:
    page = Page(html.text(said))
    assert page.elements == [] and page.said == said
    rows = Page(html.table([[said, 1]], [said, "x"]))
    assert set(rows.elements) <= {"div", "table", "thead", "tbody", "tr", "th", "td"} and rows.said.count(said) >= 2
    assert set(Page(svg.drawing([svg.words(0, 0, said)], (10, 10), said)).elements) == {"svg", "text"}


def read(shown: str) -> float:
    """What a number on a page says."""
    mantissa, _, power = shown.replace("−", "-").partition("×10")
    exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(f"{mantissa}e{exponent or 0}")


@quickly
@given(st.floats(-1e12, 1e12), st.integers(3, 6))
def test_a_number_is_right_to_its_digits(value: float, digits: int) -> None:
    assume(value == 0 or abs(value) > 1e-30)
    assert np.isclose(read(html.number(value, digits)), value, rtol=10.0 ** (1 - digits))
    assert html.number(float("nan")) == html.number(None) == "–"


@quickly
@given(numbers(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_marks_of_an_axis_are_few_even_and_within_it(low: float, span: float) -> None:
    assume(span > 1e-9 * abs(low))
    high = low + span
    marks = html.round_marks(low, high)
    assert 2 <= len(marks) <= 8
    assert all(low - 1e-9 * span <= m <= high + 1e-9 * span for m in marks)
    np.testing.assert_allclose(np.diff(marks), np.diff(marks)[0], rtol=1e-6)


@quickly
@given(arrays(7, 1e6), arrays(7, 1e6), st.lists(st.integers(0, 6), max_size=7))
def test_a_plot_lies_within_its_frame(x: np.ndarray, y: np.ndarray, missing: list[int]) -> None:
    y = y.copy()
    y[missing] = np.nan
    for drawn in (plot([("a", x, y)], "x", "y"), log_plot([("a", x, y)], "x", "y")):
        for points in drawn.split('points="')[1:]:
            at = np.array([pair.split(",") for pair in points.split('"')[0].split()], float)
            assert np.all((at >= 0) & (at <= [640, 240]))


@quickly
@given(arrays(2, 3.0), st.floats(1e-6, 1.0))
def test_every_method_is_in_the_plane_or_named(k: np.ndarray, sigma: float) -> None:
    one = {"name": "ukf", "k1": k[0], "k2": k[1], "sigma_k1": sigma, "sigma_k2": sigma, "converged": True}
    drawn = ratio_plane({"name": "mesh", "k1": 0.1, "k2": 0.2, "sigma_k1": 0.01, "sigma_k2": 0.01}, [one])
    assert "ukf" in drawn and "nan" not in drawn
