"""Parameters in body axes, compared with the truth: without attitudes from outside, the axes of `body.yaml` are known
but for half turns about the principal axes, which leave free rotation and its inertia as they are."""

from __future__ import annotations

import numpy as np

VECTORS = ("torque", "pressure", "dipole", "momentum", "kick", "centre", "swing")
"""Parameters with these names are vectors in body axes."""
SIX = ("xx", "yy", "zz", "xy", "xz", "yz")


def turned(parameters: dict[str, float], T: np.ndarray) -> dict[str, float]:
    """The same effect in axes turned by T (3, 3)."""
    out = dict(parameters)
    for name in VECTORS:
        keys = [f"{name}_{a}" for a in "xyz"]
        if all(k in out for k in keys):
            out.update(zip(keys, T @ [out[k] for k in keys], strict=True))
    keys = [f"inertia_{a}" for a in SIX]
    if all(k in out for k in keys):
        a, b, c, d, e, f = (out[k] for k in keys)
        whole = T @ np.array([[a, d, e], [d, b, f], [e, f, c]]) @ T.T
        out.update(zip(keys, whole[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], strict=True))
    elif "inertia_xx_yy" in out:
        zz, half = out["inertia_zz"], out["inertia_xx_yy"]
        xy, xz, yz = (out[f"inertia_{k}"] for k in ("xy", "xz", "yz"))
        whole = T @ np.array([[half - zz / 2, xy, xz], [xy, -half - zz / 2, yz], [xz, yz, zz]]) @ T.T
        out.update(inertia_zz=whole[2, 2], inertia_xx_yy=(whole[0, 0] - whole[1, 1]) / 2)
        out.update(inertia_xy=whole[0, 1], inertia_xz=whole[0, 2], inertia_yz=whole[1, 2])
    return out


def off(
    effects: list[dict], truth: dict[str, dict[str, float]], inertia: np.ndarray, own: np.ndarray | None = None
) -> list[tuple[str, float]]:
    """(name, error in sigmas) of every parameter found, in the one of the four axes that suits best.

    Args:
        effects: of `diagnosis.json`; truth: by effect, its parameters; inertia: (3, 3) in the truth's axes.
        own: (3, 3) from the truth's axes to those of the diagnosis, where nothing tells it the truth's.
    """
    axes = np.linalg.eigh(inertia)[1]
    best: list[tuple[str, float]] | None = None
    for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
        T = (axes * signs) @ axes.T if own is None else own
        z = []
        for e in effects:
            for name, value in turned(truth.get(e["name"], {}), T).items():
                sigma = e["sigma"].get(name)
                if sigma:  # the data show it
                    z.append((f"{e['name']}.{name}", (e["parameters"][name] - value) / sigma))
        if best is None or sum(v * v for _, v in z) < sum(v * v for _, v in best):
            best = z
    return best or []
