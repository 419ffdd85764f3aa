"""The best possible errors on pesce2017's images: Kalman's filter linearised at the truth, run by run."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.campaigns.papers._pesce2017_inertia import principal_prior, ratios_jacobian
from massprops.campaigns.papers._pesce2017_observation import euler_constraint, images
from massprops.campaigns.papers._pesce2017_run import Setup, draw, first_estimate, image_noise
from massprops.campaigns.papers._pesce2017_state import State, difference
from massprops.campaigns.papers._pesce2017_transition import transition
from massprops.campaigns.papers._pesce2017_update import Rule, update


def limit(c: dict[str, Any], seeds: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Sigmas and errors of the best linear filter, which knows the truth to linearise at.

    It starts from the same first estimates and is given the same noise as the runs of these seeds: its sigma is the
    Cramer-Rao bound, its errors are those that the noise itself decides. The differentiator of case A adds nothing to
    the images that it reads; the simulated sensor of the other cases does.

    Returns:
        sigma (steps, B, 2) of k1, k2; errors (steps, B, 3): |k1|, |k2|, and the distance of the centre of mass [m].
    """
    setup = Setup(c)
    layout = setup.layout
    features, start, noise, sensor = draw(c, seeds)
    estimate, P = first_estimate(c, setup, features, start)
    e = difference(layout, setup.truth(0, features), estimate)
    spread = np.sqrt(c["variance_k"]) * np.ones((len(seeds), 2))
    P[:, layout.k, layout.k] = principal_prior(np.repeat(setup.k[None], len(seeds), axis=0), spread[0])[1]
    sigma = np.broadcast_to(image_noise(c), noise[:, 0].shape)
    J = ratios_jacobian(setup.a)
    sigmas, errors = [], []
    for step in range(1, c["steps"] + 1):
        truth, (C, spin) = setup.truth(step, features), setup.frames[step]
        before = setup.truth(step - 1, features)
        t0, t1 = setup.times[step - 1], setup.times[step]
        _, F = transition(layout, before, t0, t1, setup.orbit, setup.largest_rate)
        P, e = F @ P @ np.swapaxes(F, -1, -2), (F @ e[..., None])[..., 0]
        _, H = images(layout, truth, setup.cameras, C, spin)
        wide, wrong = sigma, sigma * noise[:, step - 1]
        if c["pseudo"] == "sensor":
            acceleration, sigma_a = setup.sensed(step, sensor[:, step - 1])
            residual, slope = euler_constraint(layout, truth, acceleration)
            H, wide = np.concatenate([H, slope], axis=1), np.concatenate([wide, sigma_a], axis=1)
            wrong = np.concatenate([wrong, residual], axis=1)

        def observe(
            s: State, which: np.ndarray, H: np.ndarray = H, wrong: np.ndarray = wrong
        ) -> tuple[np.ndarray, np.ndarray]:
            return wrong[which], H[which]

        P = update(layout, truth, P, observe, wide, Rule(1)).P
        innovation = (H @ e[..., None])[..., 0] + wrong
        e = e - (P @ np.swapaxes(H, -1, -2) @ (innovation / wide**2)[..., None])[..., 0]
        sigmas.append(np.sqrt(np.einsum("bii->bi", J @ P[:, layout.k, layout.k] @ J.T)))
        k = np.abs(e[:, layout.k] @ J.T)
        errors.append(np.concatenate([k, np.linalg.norm(e[:, layout.r], axis=-1)[:, None]], axis=1))
    return np.stack(sigmas), np.stack(errors)


def best_rows(c: dict[str, Any], seeds: list[int]) -> list[dict[str, float]]:
    """The table's means of those errors, one row per seed: `best_k1`, `best_k2`, `best_rho_m`, and `best_steady_...`."""
    _, errors = limit(c, seeds)
    times = np.arange(1, c["steps"] + 1) * c["step_s"]
    parts = {"best_": errors[times >= c["average_from_s"]], "best_steady_": errors[times >= c["steady_from_s"]]}
    names = ("k1", "k2", "rho_m")
    return [
        {
            f"{prefix}{name}": float(part[:, b, i].mean())
            for prefix, part in parts.items()
            for i, name in enumerate(names)
        }
        for b in range(len(seeds))
    ]
