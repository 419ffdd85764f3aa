"""Hamilton quaternions, scalar first (w, x, y, z), batched over leading axes.

A unit quaternion q rotates body vectors into the reference frame: v_ref = q v_body q*. Angular velocity is in body
axes, so q_dot = q * (0, w) / 2.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import product


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Product p q: first q, then p. Shapes (..., 4)."""
    p, q = np.asarray(p), np.asarray(q)
    return _filled((4,), *product(*(p[..., i] for i in range(4)), *(q[..., i] for i in range(4))))


def _filled(shape: tuple[int, ...], *parts: np.ndarray) -> np.ndarray:
    """(..., *shape) from its elements, each (...): several times quicker than stacking them."""
    out = np.empty((*np.shape(parts[0]), len(parts)), np.asarray(parts[0]).dtype)
    for i, part in enumerate(parts):
        out[..., i] = part
    return out.reshape(*out.shape[:-1], *shape)


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse of a unit quaternion (..., 4)."""
    return np.asarray(q) * np.array([1.0, -1.0, -1.0, -1.0])


def normalise(q: np.ndarray) -> np.ndarray:
    """Unit quaternion of the same direction (..., 4)."""
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """(..., 3, 3) with v_ref = R v_body, of unit quaternions (..., 4)."""
    w, x, y, z = (np.asarray(q)[..., i] for i in range(4))
    return _filled(
        (3, 3),
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


def from_rotation_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternion (..., 4), scalar part not negative, of rotation matrices (..., 3, 3).

    Takes the largest of the four components first (Shepperd), so it never divides by a small number.
    """
    R = np.asarray(R, float)
    m = [[R[..., i, j] for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    candidates = np.stack(
        [
            np.stack([1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]], axis=-1),
            np.stack([m[2][1] - m[1][2], 1 + 2 * m[0][0] - trace, m[0][1] + m[1][0], m[0][2] + m[2][0]], axis=-1),
            np.stack([m[0][2] - m[2][0], m[0][1] + m[1][0], 1 + 2 * m[1][1] - trace, m[1][2] + m[2][1]], axis=-1),
            np.stack([m[1][0] - m[0][1], m[0][2] + m[2][0], m[1][2] + m[2][1], 1 + 2 * m[2][2] - trace], axis=-1),
        ],
        axis=-2,
    )
    size = np.stack([candidates[..., i, i] for i in range(4)], axis=-1)
    best = np.argmax(size, axis=-1)[..., None, None]
    q = normalise(np.take_along_axis(candidates, best, axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0, -q, q)


def from_rotation_vector(v: np.ndarray) -> np.ndarray:
    """Unit quaternion (..., 4) of a rotation by |v| about v (..., 3) [rad]; smooth at zero, complex-step safe."""
    v = np.asarray(v)
    square = np.sum(v * v, axis=-1, keepdims=True)
    small = np.real(square) < 1e-12
    angle = np.sqrt(np.where(small, 1.0, square))
    half_sinc = np.where(small, 0.5 - square / 48.0, np.sin(angle / 2) / angle)
    cosine = np.where(small, 1.0 - square / 8.0, np.cos(angle / 2))
    return np.concatenate([cosine, half_sinc * v], axis=-1)


def chained(turns: np.ndarray) -> np.ndarray:
    """Quaternions (n + 1, 4) from identity on, each turned from the one before by a rotation vector of (n, 3) [rad] in its own axes."""
    q = np.zeros((len(turns) + 1, 4))
    q[0, 0] = 1.0
    for k, turn in enumerate(from_rotation_vector(turns)):
        q[k + 1] = multiply(q[k], turn)
    return q


def rotation_vector(q: np.ndarray) -> np.ndarray:
    """Rotation vector (..., 3) [rad], at most pi long, of unit quaternions (..., 4)."""
    q = np.asarray(q, float)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.where(sine < 1e-9, 2.0, angle / np.where(sine < 1e-9, 1.0, sine))


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Body vectors v (..., 3) in the reference frame."""
    w, u = np.asarray(q)[..., :1], np.asarray(q)[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def nearest_rotation(M: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) nearest to matrices (..., 3, 3); of a sum of rotations, their mean (Markley 1988; Kabsch 1976)."""
    U, _, V = np.linalg.svd(M)
    U = U * np.stack([np.ones(M.shape[:-2]), np.ones(M.shape[:-2]), np.linalg.det(U @ V)], axis=-1)[..., None, :]
    return np.asarray(U @ V)


def mean_quaternion(q: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """The weighted mean (4,) of turns q (n, 4), of either sign (Markley and others 2007)."""
    mean: np.ndarray = np.linalg.eigh((q.T if weight is None else q.T * weight) @ q)[1][:, -1]
    return mean if mean[0] >= 0 else -mean


def angle_between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Angle [rad] of the rotation from q to p, shapes (..., 4) to (...)."""
    return np.linalg.norm(rotation_vector(multiply(p, conjugate(q))), axis=-1)
