"""Bodies in sunlight drawn at random, and the law of sunlight's torque that is taken from them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from massprops.diagnosis.candidate import Candidate, within_noise
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import Term, forcing_of
from massprops.diagnosis.effect_search import again
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import fit_hypothesis
from massprops.diagnosis.latent_torque import by_direction
from massprops.diagnosis.motion_path import path_from_rates
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.unnamed import torque_by_sun, without_effects
from massprops.diagnosis.verdict import may_be_named
from massprops.dynamics.sunlit_bodies import drawn_body, likely_unknowns, torque_of
from massprops.effects import effects
from massprops.geometry.vectors import sphere

FACES = "solar-pressure-on-facets"


def closed_bodies(count: int) -> list:
    """Drawn bodies without wings."""
    rng, out = np.random.default_rng(5), []
    while len(out) < count:
        normals, areas, centres = drawn_body(rng)
        if len(areas) in (6, 8, 12) and np.linalg.norm(areas @ normals) < 1e-9 * areas.sum():
            out.append((normals, areas, centres))
    return out


def test_what_one_dark_paint_feels_turns_round_with_the_sun() -> None:
    sun = sphere(40)
    for normals, areas, centres in closed_bodies(10):
        dark = np.zeros(len(areas))
        torque = torque_of(sun, normals, areas, centres, dark, dark)
        assert torque_of(-sun, normals, areas, centres, dark, dark) == pytest.approx(
            -torque, abs=1e-9 * np.abs(torque).max()
        )
        assert np.sum(torque * sun, axis=1) == pytest.approx(0.0, abs=1e-9 * np.abs(torque).max())


def test_a_mirror_facing_the_sun_is_pushed_twice_as_hard() -> None:
    normal, area, centre = np.array([[0.0, 0.0, 1.0]]), np.array([2.0]), np.array([[0.5, 0.0, 0.0]])

    def of(mirror: float, matt: float, sun: tuple) -> np.ndarray:
        return torque_of(np.array([sun]), normal, area, centre, np.array([mirror]), np.array([matt]))[0]

    # force -z at x = 0.5: torque +y
    assert of(0.0, 0.0, (0.0, 0.0, 1.0)) == pytest.approx([0.0, 1.0, 0.0])
    assert of(1.0, 0.0, (0.0, 0.0, 1.0)) == pytest.approx([0.0, 2.0, 0.0])
    assert of(0.0, 1.0, (0.0, 0.0, 1.0)) == pytest.approx([0.0, 1.0 + 2.0 / 3.0, 0.0])
    assert of(0.5, 0.5, (0.0, 0.0, -1.0)) == pytest.approx(np.zeros(3))


def test_unknowns_that_are_drawn_push_as_bodies_do() -> None:
    """Little of the torque is along the Sun, and most of it turns round with the Sun."""
    effect = effects()[FACES]
    prior = effect.momentum_prior()
    sun = sphere(60)

    def same_from_behind(unknowns: np.ndarray) -> float:
        there, back = (likely_columns(effect, s) @ unknowns for s in (sun, -sun))
        return float(np.mean((there + back) ** 2) / np.mean((there - back) ** 2))

    free = np.random.default_rng(3).standard_normal((len(prior), 200))
    z = free[: prior.shape[1]]
    there = likely_columns(effect, sun) @ (prior @ z)
    assert np.mean(np.einsum("njk,nj->nk", there, sun) ** 2) < 0.12 * np.mean(np.sum(there**2, axis=1))
    # unknowns that may each be anything know nothing of that
    assert same_from_behind(prior @ z) < 0.35 < 0.7 < same_from_behind(free)


def likely_columns(effect: object, sun: np.ndarray) -> np.ndarray:
    """(n, 3, k) torque of a unit of each parameter."""
    return np.moveaxis(np.array(effect._units(*sun.T)), 2, 0).swapaxes(1, 2)  # type: ignore[attr-defined]


def test_a_prior_turns_independent_unknowns_into_parameters() -> None:
    """Of a torque that has no `unit_torques` too."""
    path = path_from_rates(np.linspace(0, 1, 60), np.tile([0.3, 0.2, -0.1], (60, 1)))
    plain, prior = effects()["constant-body-torque"], np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    tied = SimpleNamespace(**vars(plain), momentum_prior=lambda: prior)
    free, mixed = (forcing_of(Term(effect=e), path, path.w, np.eye(3)) for e in (plain, tied))  # type: ignore[arg-type]
    assert free.momentum is not None and mixed.momentum is not None and mixed.count == 2
    assert mixed.momentum == pytest.approx(free.momentum @ prior)
    value, covariance = Term(effect=tied).values(np.array([1.0, -2.0]), np.eye(2))  # type: ignore[arg-type]
    assert value == pytest.approx([2.0, -2.0, -1.0]) and covariance == pytest.approx(prior @ prior.T)


def test_the_law_is_of_torques_of_one_size() -> None:
    columns = likely_columns(effects()[FACES], sphere(60))
    B = likely_unknowns(lambda sun: likely_columns(effects()[FACES], sun))
    assert np.mean((columns @ B) ** 2) * B.shape[1] == pytest.approx(1.0, rel=0.15)


def test_a_process_over_directions_may_be_anything_there() -> None:
    knots = sphere(80)
    shapes = by_direction(knots, knots)
    assert shapes @ shapes.T == pytest.approx(np.exp(-np.arccos(np.clip(knots @ knots.T, -1.0, 1.0)) / 2.0), abs=0.06)


@pytest.mark.parametrize(("kind", "seed", "pressure"), [("jet-in-sunlight", 22, False), ("sunlight", 12, True)])
def test_a_jet_that_fires_in_sunlight_is_no_pressure_of_it(kind: str, seed: int, pressure: bool) -> None:
    """Faces follow both within the noise, and are likelier than a torque that wanders in time."""
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded(kind, seed)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    by_sun = torque_by_sun(record, unknown)
    assert by_sun is not None and within_noise(by_sun)
    term = Term(effect=effects()[FACES])
    faces = Candidate(alone=fit_hypothesis(record, Hypothesis(terms=(term,), latent=False), again(unknown)))
    assert within_noise(faces.alone) and may_be_named(faces, base, unknown)
    assert may_be_named(faces, base, unknown, by_sun) == pressure


def test_without_the_sun_no_torque_depends_on_it() -> None:
    from diagnosis.test_momentum_balance import tumble

    from massprops.diagnosis.record import record_of_rates

    record = record_of_rates(tumble(rate=100.0))
    fit = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    assert torque_by_sun(record, fit) is None
