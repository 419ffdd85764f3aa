"""What the pages of a diagnosis say of a law."""

from __future__ import annotations

from typing import Any

import pytest

from massprops.diagnosis.page_parts import law, notes, verdict
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
    assert "not shown" in shown and "± 0.5" in shown.replace("0.50", "0.5")
    assert notes({"warnings": []}) == "" and "<li>a</li>" in notes({"warnings": ["a"]})
