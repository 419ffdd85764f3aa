"""Tables that commands print."""

from __future__ import annotations

from typing import Any

from massprops_cli.compare import comparison_table
from massprops_cli.diagnose import diagnosis_table
from massprops_cli.estimate import _against_truth

BOTH = {"before": 1.5, "after": 1.0}


def _named(effect: dict[str, Any]) -> dict[str, Any]:
    """A document that names an effect."""
    gap = {"fitted": BOTH, "held_out": BOTH}
    return {"verdict": "named", "reason": "r", "effects": [effect], "gap": gap, "where": []}


def test_errors_against_the_truth_are_one_line_a_method_in_degrees() -> None:
    found = {"ekf": {"k1_error": 0.01, "attitude_rms_rad": 0.0174533}, "ukf": {"k1_error": None}}
    head, first, second = (line.split() for line in _against_truth(found))
    assert head[:4] == ["error", "against", "the", "truth"] and "[deg]" in head
    assert first == ["ekf", "0.01", "-", "1", "-", "-", "-"] and second == ["ukf", *6 * ["-"]]
    assert _against_truth({}) == []


def test_the_values_that_a_run_recommends_are_marked_and_stand_first() -> None:
    row = {"quantity": "volume", "cad": 1.0, "ours": 1.1, "error": 0.1, "relative_error": 0.1, "error_text": "+10 %"}
    row |= {"unit": "m^3", "interval_90": None, "holds": None}
    sides = dict.fromkeys(("median", "mean_signed", "rms", "p95", "hausdorff"), 0.0)
    distances = {"ours": sides, "cad": sides, "length": 1.0}
    document = {"rows": [row], "fused": [row], "recommended": "fused"}
    said = comparison_table({**document, "distances": distances, "scale": 1.0, "free_scale": False})
    heads = [line for line in said.splitlines() if line.startswith("from ")]
    assert heads == ["from mesh and motion together (recommended):", "from the mesh:"]


def test_a_diagnosis_names_places_in_words_and_none_where_nothing_is_missing() -> None:
    place = {"interval_s": [0.0, 2.5], "z": 8.0, "size": 3.21, "features": []}
    where = [{**place, "channel": "cam1 v"}, {**place, "channel": "tracks", "direction": "+y"}]
    found = {"verdict": "unexplained", "reason": "r", "effects": [], "gap": {"fitted": BOTH, "held_out": BOTH}}
    said = diagnosis_table({**found, "where": where})
    assert (
        "rows of the pixels in cam1, 0 to 2.5 s, 3.21 times the noise" in said
        and "features on the +y side of the body" in said
    )
    assert "departs" not in diagnosis_table({**found, "verdict": "none", "where": where})


def test_parameters_that_the_data_do_not_show_are_one_line_without_a_number() -> None:
    values = {"a": 2.0, "span": 9.0, **dict.fromkeys(("x", "y"))}
    effect = {"name": "e", "held_out_gain": None, "delta_bic": 10.0, "parameters": values}
    effect |= {"sigma": {"a": 0.5, "span": 0.0, "x": None, "y": None}, "units": dict.fromkeys(values, "s")}
    found = _named(effect)
    said = diagnosis_table(found).splitlines()
    assert any(line.split() == ["a", "2", "±", "0.5", "s"] for line in said)
    assert any(line.split() == ["span", "9", "s"] for line in said) and "    not measurable: x, y" in said
    effect["parameters"] = dict.fromkeys(f"p{k}" for k in range(100))
    assert "    not measurable: 100 of 100 parameters" in diagnosis_table(found).splitlines()


def test_an_unknown_torque_is_told_with_its_sigma_and_what_it_goes_along_with() -> None:
    latent = {"shown_rms": 2.1e-5, "shown_sigma": 9e-6, "correlates": [{"with": "torque x by Sun z", "r": 0.52}]}
    found = {"verdict": "unexplained", "reason": "r", "effects": [], "where": [], "latent": latent}
    said = diagnosis_table(found | {"gap": {"fitted": BOTH, "held_out": BOTH}})
    assert "unknown torque: 2.1e-05 ± 9e-06 rad s^-2 rms, goes along: torque x with Sun z (r = +0.52)" in said


def test_what_is_named_says_in_which_axes() -> None:
    effect = {"name": "e", "held_out_gain": None, "delta_bic": 10.0, "parameters": {}, "sigma": {}, "units": {}}
    found = _named(effect)
    assert (
        "  body axes are those of attitude0"
        in diagnosis_table({**found, "axes": "body axes are those of attitude0"}).splitlines()
    )
