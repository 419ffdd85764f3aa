"""What a difference of inertia says about mass that the even shape lacks, and the picture of residuals on the body."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.search.body_picture import body_picture, colour_of
from massprops.diagnosis.search.hidden_mass import hidden_mass
from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements
from massprops.sensing.predict import Seen


def _box(count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Points of an even box (n, 3), turned, and its second moment for a mass of 1."""
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(*[(np.arange(count) + 0.5) / count - 0.5] * 3, indexing="ij"), -1).reshape(-1, 3)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    points = (grid * [2.0, 1.2, 0.7]) @ turn.T
    return points, points.T @ points / len(points)


def _inertia(points: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """About the centre of mass, mean moment 1."""
    x = points - mass @ points / mass.sum()
    S = (mass[:, None] * x).T @ x
    inertia = np.trace(S) * np.eye(3) - S
    return 3.0 * inertia / np.trace(inertia)


def test_a_point_mass_is_found_and_preferred() -> None:
    points, _ = _box()
    even = np.full(len(points), 1.0 / len(points))
    place = np.array([0.5, 0.4, -0.2])
    found = hidden_mass(_inertia(points, even), _inertia(np.vstack([points, place]), np.append(even, 0.1)))
    assert abs(np.dot(found["direction"], place / np.linalg.norm(place))) > 0.999
    assert found["left"] < 0.01 and found["better"] == "point mass"
    # reduced mass of 0.1 beside 1, over the body's mean moment
    moment = 2.0 * np.mean(np.sum(points**2, axis=1)) / 3.0
    assert found["second_moment"] == pytest.approx(0.1 / 1.1 * place @ place / moment, rel=0.02)


def test_a_density_gradient_is_found_and_preferred() -> None:
    points, S = _box()
    g = np.array([0.5, -0.4, 0.3])
    even, uneven = np.ones(len(points)), 1.0 + points @ g
    assert uneven.min() > 0
    found = hidden_mass(_inertia(points, even), _inertia(points, uneven))
    gradient = found["gradient"]
    assert abs(np.dot(gradient["direction"], g / np.linalg.norm(g))) > 0.99
    assert gradient["left"] < 0.02 and found["better"] == "density gradient"
    shift = S @ g
    moment = 2.0 * np.mean(np.sum(points**2, axis=1)) / 3.0
    assert gradient["second_moment"] == pytest.approx(shift @ shift / moment, rel=0.02)


def test_the_picture_shows_the_feature_that_is_wrong() -> None:
    rng = np.random.default_rng(0)
    epoch, feature = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(4), indexing="ij"))
    seen = Seen(epoch, np.zeros(240, int), feature, np.zeros(240))
    none = np.zeros(0, int)
    m = Measurements(seen, np.zeros((240, 2)), np.ones(240), none, none, none)
    noise = rng.standard_normal((240, 2))
    empty = (np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    wrong = Residuals(noise + 4.0 * (feature == 2)[:, None], *empty)
    points = rng.standard_normal((4, 3))
    svg = body_picture(points, np.array([3, 5, 8, 9]), m, wrong, Residuals(noise, *empty), points)
    red = [line for line in svg.split("<circle") if "#c0392b" in line]
    assert len(red) == 3 and all("feature 8:" in line for line in red), "once in each view, before and not after"
    assert svg.count("<title>") == 24 and colour_of(1.0, 5.0) == "#27ae60"
