"""What the pages of a diagnosis say of a law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprops.diagnosis.page_parts import law, notes, residuals, simulator, verdict, wheel
from massprops.report.page import of_sections

LAW: dict[str, Any] = {
    "formula": "torque = 8.1e-05 [max(0, s_z) along x]",
    "stated": True,
    "because": None,
    "terms": [
        {
            "term": "max(0, s_z) along x",
            "coefficient": 8.1e-5,
            "sigma": 2e-6,
            "unit": "rad s^-2",
            "probability": 0.97,
            "same_here": ["s_z along x"],
        }
    ],
    "rivals": [{"terms": ["max(0, s_z) w_x along x", "s_y along y"], "log_evidence": -2.5}],
    "catalogue": {"effects": ["constant-body-torque"], "log_evidence": 31.5},
    "fitted": {"before": 7.25, "after": 1.02},
    "held_out": {"before": 8.5, "after": None},
    "effect": "law.py",
    "model": "law.yaml",
}


def test_a_law_is_on_the_page_with_its_terms_and_its_figures() -> None:
    shown = law({"law": LAW})
    for part in (
        "8.1e-05 [max(0, s_z) along x]",
        "0.97",
        "7.25",
        "1.02",
        "law.py",
        "law.yaml",
        "rad s⁻²",
        "= s_z along x",
        "w_x along x + s_y",
        "Over constant-body-torque of the catalogue",
    ):
        assert part in shown
    assert 'class="done"' in shown and "Not stated" not in shown


@pytest.mark.parametrize("because", ["other terms explain the record <nearly> as well"])
def test_a_doubtful_law_says_why(because: str) -> None:
    shown = law({"law": LAW | {"stated": False, "because": because}})
    assert (
        'class="warning"' in shown and "Not stated" in shown and "&lt;nearly&gt;" in shown and "<nearly>" not in shown
    )


def test_no_law_looked_for_is_no_section_and_none_found_says_so() -> None:
    assert law({}) == ""
    none = {"formula": None, "terms": [], "stated": False, "because": "the record asks for no term"}
    assert "the record asks for no term" in law({"law": none})
    assert "A law" not in of_sections("t", [("law", "A law", law({})), ("x", "Other", "<p>y</p>")])


def test_parameters_that_are_not_shown_have_no_number() -> None:
    effect = {
        "name": "drag",
        "parameters": {"a": None, "b": 2.0},
        "sigma": {"a": None, "b": 0.5},
        "units": {"a": "1", "b": "s"},
    }
    gap = {"held_out": {"before": 3.0, "after": 1.04}}
    shown = verdict({"verdict": "named", "reason": "Air.", "axes": "body axes", "effects": [effect], "gap": gap})
    assert "predicted to 1.04 times the noise with it, and to 3.00 times without" in shown
    assert "not shown by the data" in shown and "± 0.5" in shown.replace("0.50", "0.5")
    many = {f"p{k}": None for k in range(99)} | {"last": 1.5}
    effect |= {"parameters": many, "sigma": dict.fromkeys(many), "units": dict.fromkeys(many, "1")}
    shown = verdict({"verdict": "named", "reason": "Air.", "axes": "body axes", "effects": [effect], "gap": gap})
    assert shown.count("<tr>") == 3 and "99 of 100" in shown and "1.500<" in shown, "a value that is held has no ±"
    assert notes({"warnings": []}) == "" and "<li>a</li>" in notes({"warnings": ["a"]})


def test_residuals_are_drawn_over_time_beside_the_noise() -> None:
    t = np.linspace(0.0, 1.0, 5)
    both = residuals([("before", t, np.full(5, 100.0)), ("after", t, np.ones(5))], "rate")
    assert both.count("<polyline") == 3 and 'class="noise"' in both and "before" in both and "after" in both
    assert residuals([("before", t, np.ones(5))], "rate").count("<polyline") == 2


def test_a_wheel_has_its_band() -> None:
    t = np.linspace(0.0, 1.0, 5)
    assert '<polygon class="band"' in wheel(t, t, 0.1 + 0 * t) and "polygon" not in wheel(t, t)


def test_a_simulator_is_on_the_page() -> None:
    assert simulator({}) == ""
    box = {"name": "my:f", "parameters": {"a": 2.0, "b": None}, "sigma": {"a": 0.5, "b": None}}
    shown = simulator({"simulator": box | {"units": {"a": "s", "b": "s"}, "fitted": 1.02, "held_out": 1.1}})
    assert "my:f leaves 1.02" in shown and "2.000 ± 0.50" in shown and "not shown by the data" in shown


def test_a_record_that_shows_nothing_is_not_said_to_lack_nothing() -> None:
    doc = {"verdict": "none", "effects": [], "axes": "", "gap": {"held_out": {"before": None, "after": None}}}
    shown = verdict({**doc, "reason": "not observable: the body turns by 9 deg only"})
    assert 'class="warning"' in shown and "cannot be told" in shown and "no effect is missing" not in shown
    assert "no effect is missing" in verdict({**doc, "reason": "a free rigid body explains the measurements"})
