"""A tumbling body's sequence made by arithmetic alone, with its truth, and an estimator simple enough to be trusted."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
from estimators.tumbling import images, pinholes

from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.result import Estimate
from massprops.mass.ratio_space import inertia_of
from massprops.sequence import AttitudeSeries, Camera, Sequence, Tracks, write_sequence

TRUE_K = np.array([-0.25, -0.15])
AXES = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def make_sequence(
    folder: Path,
    seed: int = 0,
    stereo: bool = True,
    attitude: bool = False,
    epochs: int = 120,
    spin: tuple[float, float, float] = (0.35, 0.8, 0.3),
    k: np.ndarray = TRUE_K,
    sigma_px: float = 0.05,
) -> Path:
    """A body 2 m across, 8 m away, in free motion; features numbered from 100."""
    rng = np.random.default_rng(seed)
    inertia = inertia_of(k, AXES)
    times = 0.1 * np.arange(epochs)
    q, w = propagate(np.array([0.5, 0.5, -0.5, 0.5]), AXES @ np.array(spin), inertia, times, largest_turn=0.02)
    position = np.array([0.1, -0.1, 8.0]) + times[:, None] * np.array([0.002, 0.001, -0.003])
    points = rng.uniform(-1, 1, (12, 3))
    lens, bases = (900.0, 900.0, 320.0, 240.0), (0.0, 0.6)[: 2 if stereo else 1]
    exact = images(pinholes(lens, bases), q, position, points)
    rows = []
    cameras = {}
    stamps = np.round(times * 1e9).astype(np.int64)
    for c, base in enumerate(bases):
        pose = np.eye(4)
        pose[0, 3] = base
        cameras[c] = Camera((640, 480), np.array(lens), T_BS=pose, sigma_px=sigma_px)
        uv = exact[:, c] + sigma_px * rng.standard_normal(exact[:, c].shape)
        rows += [(stamps[i], c, 100 + j, uv[i, j]) for i in range(epochs) for j in range(len(points))]
    rows.sort(key=lambda r: r[:3])
    tracks = Tracks(*(np.array([r[i] for r in rows]) for i in range(4)))
    series = None
    if attitude:
        noisy = multiply(q, from_rotation_vector(2e-4 * rng.standard_normal((epochs, 3))))
        series = AttitudeSeries(stamps, noisy, np.full(epochs, 2e-4))
    truth = {
        "timestamp_ns": stamps, "position": position, "q": q, "w": w, "k1": float(k[0]), "k2": float(k[1]),
        "inertia": inertia.tolist(), "centre_of_mass_m": [0.0, 0.0, 0.0],
    }  # fmt: skip
    return write_sequence(folder, Sequence(cameras=cameras, tracks=tracks, attitude=series), truth)


def simple_method(name: str = "simple", needs: tuple[str, ...] = ("attitude|stereo",)) -> ModuleType:
    """The start's own inertia as an estimate; a prior's inertia is averaged in, blindly, by its stated sigma."""
    module = ModuleType(name)
    module.NAME, module.ORDER, module.SENTENCE, module.NEEDS = name, 1, "The start itself.", needs  # type: ignore[attr-defined]

    def estimate(problem, prior, start):  # type: ignore[no-untyped-def]
        k, axes = ratios(start.inertia)
        cov = np.eye(2) * 0.01**2
        if prior.inertia is not None and prior.k_sigma is not None:
            weight = np.linalg.inv(np.diag(prior.k_sigma**2))
            cov = np.linalg.inv(np.linalg.inv(np.eye(2) * 0.01**2) + weight)
            k = cov @ (k / 0.01**2 + weight @ ratios(prior.inertia)[0])
        n = len(start.times)
        return Estimate(
            name, True, True, "", float(k[0]), float(k[1]), cov, inertia_of(k, axes), axes, np.eye(3) * 0.01**2,
            start.times, start.q, start.w, start.position, None, np.full((n, 3), 2e-3), np.full((n, 3), start.sigma_w),
            features=start.features, feature_ids=problem.features, body_frame=start.body_frame, innovation=1.0,
            k_history=np.tile(k, (n, 1)), k_sigma_history=np.full((n, 2), 0.01),
        )  # fmt: skip

    module.estimate = estimate  # type: ignore[attr-defined]
    return module
