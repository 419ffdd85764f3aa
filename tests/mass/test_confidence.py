"""One word of trust, its reasons, and replicates that are bodies."""

from __future__ import annotations

import numpy as np
import pytest
from some_evidence import evidence

from massprops.errors import NotPossible
from massprops.mass.confidence import Evidence, confidence
from massprops.mass.integrals import mesh_integrals, scale_integrals
from massprops.mass.intervals import intervals, valid_bodies
from massprops.mass.properties import properties_of_integrals


@pytest.mark.parametrize(
    ("given", "level", "word"),
    [
        (evidence(0.03, 0.05, 0.0, 40, 40), "high", "±3 %"),
        (evidence(0.10, 0.05, 0.0, 40, 40), "medium", "±10 %"),
        (evidence(0.30, 0.05, 0.0, 40, 40), "low", "±30 %"),
        (evidence(0.03, 0.70, 0.0, 40, 40), "low", "70 % of the surface"),
        (evidence(0.03, 0.05, 0.0, 40, 31), "medium", "9 of 40 images"),
        (evidence(0.03, 0.05, 0.0, 40, 40, unjoined=1), "medium", "1 other placement of"),
        (evidence(0.03, 0.05, 0.0, 40, 40, unjoined=1, differing=1), "low", "another volume"),
        (evidence(0.03, 0.05, 0.0, 40, 40, alike=True), "medium", "if it was only moved"),
        (evidence(0.03, 0.05, 0.0, 40, 40, matches_required=45), "medium", "sides of the object look alike"),
        (evidence(0.03, 0.05, 0.0, 40, 40, unsure=True), "low", "no two results agree"),
        (evidence(0.03, 0.05, 0.0, 40, 40, turned=True), "high", "±3 %"),
        (evidence(0.15, 0.41, 0.0, 48, 48, turned=True), "low", "may be hollow"),
        (evidence(0.15, 0.41, 0.0, 48, 48), "medium", "±15 %"),
        (evidence(0.03, 0.05, 0.0, 40, 40, valid=0.3), "low", "enclose no volume"),
        (evidence(0.03, 0.05, 0.0, 40, 40, outside=0.2), "medium", "up to 20 % of the images"),
        (evidence(0.03, 0.05, 0.0, 40, 40, outside=0.35), "low", "cameras or the silhouettes are wrong"),
        (evidence(1.5, 0.05, 0.0, 40, 40), "low", "leave open how large the volume is"),
        (evidence(0.03, 0.05, 0.0, 40, 40, contradicted=0.07, contradicting="a and b"), "medium", "between a and b"),
        (evidence(0.3, 0.7, 0.0, 40, 40, contradicted=0.23), "low", "23 % of the matches"),
        (evidence(0.03, 0.05, 0.0, 40, 40, shutter="the shutter may read"), "medium", "the shutter may read"),
        (evidence(0.03, 0.05, 0.0, 40, 40, overlap=0.92), "medium", "overlap by only 92 %"),
        (evidence(0.03, 0.05, 0.0, 40, 40, overlap=0.63), "low", "overlap by only 63 %"),
    ],
)
def test_the_worst_reason_decides_and_comes_first(given: Evidence, level: str, word: str) -> None:
    found = confidence(given)
    assert found["level"] == level and word in found["because"][0]


def test_two_readings_are_low_and_said_first() -> None:
    found = confidence(
        evidence(0.03, 0.70, 0.0, 40, 40, readings=("the one (--object X,Y)", "the other (--keep-support)"))
    )
    assert found["level"] == "low" and "(--object X,Y) (measured here), or the other" in found["because"][0]
    assert "70 %" in found["because"][1]


def test_what_stood_on_its_support_is_said_without_lowering_trust() -> None:
    found = confidence(evidence(0.03, 0.05, 0.15, 40, 40))
    assert found["level"] == "high" and "15 % of the surface stood" in found["because"][-1]


def test_a_collapsed_replicate_is_no_opinion() -> None:
    import trimesh

    box = trimesh.creation.box((1.0, 2.0, 3.0))
    own = mesh_integrals(np.asarray(box.vertices), np.asarray(box.faces))
    rng = np.random.default_rng(0)
    good = own * (1 + 0.01 * rng.standard_normal((200, 1)))
    collapsed, impossible = own.copy(), own.copy()
    collapsed[0] = -1.0
    impossible[4:] = own[4:] * [-0.2, 1, 1, 1, 1, 1]
    rows = np.vstack([good, collapsed, impossible])
    assert valid_bodies(rows).tolist() == [True] * 200 + [False, False]
    bounds = intervals(rows, properties_of_integrals(own, 1.0))
    assert bounds["principal_moments"][0][0] > 0.9 * properties_of_integrals(own, 1.0).principal_moments[0]


def test_a_body_turned_over_that_may_be_a_shell_is_said_to_be() -> None:
    found = confidence(evidence(0.6, 0.41, 0.0, 48, 48, turned=True, behind_fill=0.9))
    assert "90 % less volume" in found["because"][-1] and "underside" not in found["because"][-1]


def test_where_many_replicates_collapse_the_body_may_be_as_small_as_you_like() -> None:
    import trimesh

    box = trimesh.creation.box((1.0, 2.0, 3.0))
    own = mesh_integrals(np.asarray(box.vertices), np.asarray(box.faces))
    rng = np.random.default_rng(0)
    good = own * (1 + 0.3 * np.abs(rng.standard_normal((100, 1))))
    lost = np.tile(own, (60, 1))
    lost[:, 0] = -1.0
    whole = properties_of_integrals(own, 1.0)
    few, many = (intervals(np.vstack([good, lost[:n]]), whole) for n in (4, 60))
    assert few["volume"][0] == pytest.approx(whole.volume) and few["k1"][1] < 0
    assert many["volume"][0] == 0.0 and [low for low, _ in many["principal_moments"]] == [0.0] * 3
    assert many["k1"][1] == many["k2"][1] == 0.0
    assert many["volume"][1] == few["volume"][1], "what did not collapse says how large it may be"
    twice = scale_integrals(own, 2.0)
    for given, rows in ((True, np.vstack([good, lost])), (False, np.vstack([good, lost[:4]]))):
        within = intervals(rows, whole, twice)
        held = [within["volume"][1], *(high for _, high in within["principal_moments"])]
        largest = np.array([8 * whole.volume, *(32 * whole.principal_moments)])
        assert np.allclose(held, largest) if given else np.all(held < 0.5 * largest), (
            "no larger than its silhouettes allow"
        )


def test_replicates_of_which_none_is_a_body_give_no_interval() -> None:
    import trimesh

    box = trimesh.creation.box((1.0, 2.0, 3.0))
    own = mesh_integrals(np.asarray(box.vertices), np.asarray(box.faces))
    with pytest.raises(NotPossible, match="everything open"):
        intervals(np.tile(-own, (100, 1)), properties_of_integrals(own, 1.0))


def drawn(size: tuple[float, float, float], sigma: float, rng: np.random.Generator) -> np.ndarray:
    """(r, 10) integrals of boxes with each side, and the directions of their axes, off by 1-sigma `sigma`."""
    import trimesh

    rows = []
    for _ in range(200):
        box = trimesh.creation.box(np.array(size) * (1 + sigma * rng.standard_normal(3)))
        vertices = np.asarray(box.vertices) @ (np.eye(3) + sigma * rng.standard_normal((3, 3)))
        rows.append(mesh_integrals(vertices, np.asarray(box.faces)))
    return np.array(rows)


@pytest.mark.parametrize(("side", "equal"), [(1.0, True), (1.03, True), (1.5, False)])
def test_moments_that_may_be_equal_have_a_ratio_that_reaches_to_zero(side: float, equal: bool) -> None:
    """Errors drive like moments apart, whatever the body: without the test the interval of k2 of a square bar ends short of 0."""
    rng = np.random.default_rng(4)
    rows = drawn((side, 1.0, 3.0), 0.02, rng)
    estimate = properties_of_integrals(rows[0], 1.0)
    bounds = intervals(rows, estimate)
    assert (bounds["k2"][1] == 0.0) == equal and bounds["k1"][1] < -1
    assert bounds["k2"][0] < estimate.k2 <= bounds["k2"][1]


def test_a_hollow_that_another_placement_shows_is_said() -> None:
    found = confidence(evidence(0.03, 0, 0, 40, 40, unjoined=1, hollow_likely=0.5, hollow_elsewhere=True))
    assert "another placement, which" in found["because"][-1] and "50 % less volume" in found["because"][-1]


def test_dark_places_that_may_be_holes_are_a_reason() -> None:
    found, many = (confidence(evidence(0.06, 0.04, 0.0, 40, 40, holes=3, holes_share=share)) for share in (0.08, 0.12))
    assert (found["level"], many["level"]) == ("medium", "low")
    assert any("3 dark places" in line and "8 % less volume" in line for line in found["because"])
    assert confidence(evidence(0.03, 0.04, 0.0, 40, 40, holes=1, holes_share=0.001))["level"] == "high"


def test_holes_that_were_opened_are_a_reason() -> None:
    found = confidence(evidence(0.03, 0.04, 0.0, 40, 40, opened=1, opened_share=0.05))
    assert found["level"] == "medium"
    assert found["because"][0].startswith("1 hole was opened through the object (5 % of the volume)")
    assert confidence(evidence(0.03, 0.04, 0.0, 40, 40, opened=2, opened_share=0.001))["level"] == "high"
