"""All poses and all points of a body at once: one Gauss-Newton step, the poses eliminated first.

Taking turns (poses, then points, then poses again) creeps when a camera measures depth a hundred times worse than
direction, as a short baseline does; the joint step does not.
"""

from __future__ import annotations

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise, rotation_matrix
from massprops.geometry.vectors import skew

LARGEST_TURN = 0.3
"""Of one step [rad]."""


def joint_step(
    q: np.ndarray, shift: np.ndarray, body: np.ndarray, seen: np.ndarray, information: np.ndarray, use: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Better q (n, 4), shift (n, 3) and body (m, 3); the first epoch's pose is kept, as it defines the body axes.

    Args:
        seen: (n, m, 3) measured in the camera; information: (n, m, 3, 3); use: (n, m) which to take.
    """
    m = use.shape[1]
    R = rotation_matrix(q)
    arm = body @ np.swapaxes(R, 1, 2)
    error = np.where(use[..., None], seen - shift[:, None] - arm, 0.0)
    flat, WR, inverse, AB, S = _eliminated(R, arm, information, use)
    g = (flat @ error.reshape(-1, 3 * m, 1))[..., 0]
    h = (np.swapaxes(WR, -1, -2) @ error[..., None]).sum(axis=0).reshape(-1)
    rest = h - np.einsum("nap,na->p", AB, g)
    scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
    known = np.diag(S) > 1e-200
    S = np.where(known[:, None] & known, S / np.outer(scale, scale), np.eye(3 * m))
    move = np.linalg.solve(S + 1e-12 * np.eye(3 * m), np.where(known, rest / scale, 0.0)) / scale
    step = np.einsum("nab,nb->na", inverse, g) - AB @ move
    size = float(np.abs(step[:, :3]).max(initial=0.0))
    damp = min(1.0, LARGEST_TURN / max(size, 1e-12))
    q = normalise(multiply(from_rotation_vector(damp * step[:, :3]), q))
    return q, shift + damp * step[:, 3:], body + damp * move.reshape(m, 3)


def shared_error(q: np.ndarray, body: np.ndarray, information: np.ndarray, use: np.ndarray, modes: int) -> np.ndarray:
    """How the body's own uncertainty turns every pose: (n, 3, s) turns about reference axes per unit error.

    The s errors are independent and of unit variance; the largest are kept, by how far they turn the poses against
    each other. Poses carry these errors in common, on top of their own.
    """
    R = rotation_matrix(q)
    _, _, _, AB, S = _eliminated(R, body @ np.swapaxes(R, 1, 2), information, use)
    values, vectors = np.linalg.eigh(inverse_of(S))
    turns = -AB[:, :3] @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    # what turns all poses alike only turns the body axes
    apart = turns - turns.mean(axis=0)
    size = np.sum(apart**2, axis=(0, 1))
    return np.asarray(turns[:, :, np.argsort(-size)[:modes]])


def _eliminated(R: np.ndarray, arm: np.ndarray, information: np.ndarray, use: np.ndarray) -> tuple[np.ndarray, ...]:
    """The parts of the normal equations with the poses eliminated.

    Returns:
        weighted derivatives by the poses (n, 6, 3 m) and by the points (n, m, 3, 3); the inverse of the poses' normal matrix
        (n, 6, 6) with the first pose held; its product with the cross term (n, 6, 3 m); the points' reduced normal matrix (3 m, 3 m).
    """
    n, m = use.shape
    W = np.where(use[..., None, None], information, 0.0)
    by_pose = np.zeros((n, m, 3, 6))
    by_pose[..., :3] = -skew(arm)
    by_pose[..., 3:] = np.eye(3)
    WP, WR = W @ by_pose, W @ R[:, None]
    flat = np.swapaxes(WP.reshape(n, 3 * m, 6), 1, 2)
    A = flat @ by_pose.reshape(n, 3 * m, 6)
    B = (np.swapaxes(flat.reshape(n, 6, m, 3), 1, 2) @ R[:, None]).swapaxes(1, 2).reshape(n, 6, 3 * m)
    C = (np.swapaxes(R, 1, 2)[:, None] @ WR).sum(axis=0)
    inverse = inverse_of(A)
    inverse[0] = 0.0
    AB = inverse @ B
    S = -B.reshape(6 * n, 3 * m).T @ AB.reshape(6 * n, 3 * m)
    for i in range(m):
        S[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += C[i]
    return flat, WR, inverse, AB, S
