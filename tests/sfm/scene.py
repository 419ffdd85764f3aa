"""A turning cloud of points seen by a still camera, with known truth; nothing is rendered."""

import numpy as np
from scipy.spatial.transform import Rotation

from massprops.sfm.points import SparsePoints, project
from massprops.views import Views


def make(n=12, m=150, focal=900.0, k1=0.0, noise=0.0, seed=0, step_deg=8.0):
    """Views and points with every point seen in every view."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (m, 3))
    R = (
        Rotation.from_euler("y", (np.arange(n) * step_deg)[:, None], degrees=True)
        * Rotation.from_euler("x", 20, degrees=True)
    ).as_matrix()
    t = np.tile([0.05, -0.02, 8.0], (n, 1))
    K = np.tile(np.array([[focal, 0, 319.5], [0, focal, 239.5], [0, 0, 1.0]]), (n, 1, 1))
    D = np.tile([k1, 0, 0, 0], (n, 1))
    views = Views(
        tuple(f"cam0/{i:06d}.png" for i in range(n)),
        np.arange(n) * 10**9,
        np.tile([640, 480], (n, 1)),
        K,
        D,
        R,
        t,
    )
    v, p = np.repeat(np.arange(n), m), np.tile(np.arange(m), n)
    uv = project(K[v], D[v], R[v], t[v], xyz[p]) + noise * rng.normal(size=(n * m, 2))
    points = SparsePoints(np.arange(1, m + 1), xyz, np.zeros((m, 3), np.uint8), np.zeros(m), v, p, uv)
    return views, points
