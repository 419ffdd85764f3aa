"""The free motion that several models of one turning body have in common.

Each model is a piece of the footage in a frame and a size of its own, which nothing in its images tells. But the camera
does not turn, so that all models see one angular momentum, one centre of mass that moves evenly on a straight line, and
one inertia. A free rigid body's motion has few parameters: fitted to all models at once, it tells how they lie to each
other across a gap of some tens of degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.dynamics.rigid_body import propagate

STEP_RAD = 0.1
"""Turn in one step of the integration; the error is 1e-7 rad a revolution."""

PRIOR = 1.0
"""Standard deviation of the logarithms of the inertia about those of a sphere: a rod of 10 to 1 is 2.7 off, and is still found
where the motion tells it."""

MOST_LOG = 2.5
"""Most that the logarithm of the inertia may be off a sphere's."""

MOST_TURN = 1.5
"""Most that a turn may be off the first guess [rad]."""

LEAST_SIGMA = 2e-4
"""Least standard deviation of an attitude [rad]: without it two images and no noise would be certain of everything."""


@dataclass(frozen=True)
class Piece:
    """The images of one model: times (n,) in any unit; R (n, 3, 3) and t (n, 3), model to camera. The model's origin is near the
    middle of what was seen."""

    times: np.ndarray
    R: np.ndarray
    t: np.ndarray


OUTLYING_RAD = 0.005
"""Attitudes that are off by more than this count less in a robust fit: those of images held by few points."""


@dataclass(frozen=True)
class FreeRotation:
    """A free rigid body's attitude over time.

    Attributes:
        attitude: (3, 3) body to camera at the time `begin`.
        rate: (3,) there, in the body's axes [rad per unit of time].
        inertia: (5,) its logarithm but for the size, in `BASIS`.
        begin, unit: of time, as those of `Piece`.
    """

    attitude: np.ndarray
    rate: np.ndarray
    inertia: np.ndarray
    begin: float
    unit: float

    def attitudes(self, times: np.ndarray, change: np.ndarray | None = None) -> np.ndarray:
        """(m, n, 3, 3) body to camera at times (n,), of motions changed by (m, 11): a turn in the camera's axes, rate and inertia. Not
        numbers from where the integration of one fails on, by an inertia far from all that bodies have.
        """
        from scipy.spatial.transform import Rotation as Turn

        x = np.zeros((1, 11)) if change is None else change
        q0 = (Turn.from_rotvec(x[:, :3]) * Turn.from_matrix(self.attitude)).as_quat()[:, [3, 0, 1, 2]]
        rate, inertia = self.rate + x[:, 3:6], inertia_of_log(self.inertia + x[:, 6:11])
        clock = (np.asarray(times, float) - self.begin) / self.unit
        out = np.zeros((len(x), len(clock), 3, 3))
        for side in (clock >= 0, clock < 0):
            on_side = np.flatnonzero(side)
            on_side = on_side[np.argsort(np.abs(clock[on_side]), kind="stable")]
            q, _ = propagate(q0, rate, inertia, np.r_[0.0, clock[on_side]], largest_turn=STEP_RAD, compiled=True)
            q = q[1:].reshape(-1, 4)[:, [1, 2, 3, 0]]
            known = np.isfinite(q).all(axis=1)
            R = np.full((len(q), 3, 3), np.nan)
            R[known] = Turn.from_quat(q[known]).as_matrix() if known.any() else 0.0
            out[:, on_side] = R.reshape(len(on_side), len(x), 3, 3).transpose(1, 0, 2, 3)
        return out

    def changed(self, x: np.ndarray) -> FreeRotation:
        """The motion changed by x (11,), as in `attitudes`."""
        from scipy.spatial.transform import Rotation as Turn

        turned = Turn.from_rotvec(x[:3]).as_matrix() @ self.attitude
        return replace(self, attitude=turned, rate=self.rate + x[3:6], inertia=self.inertia + x[6:11])


@dataclass(frozen=True)
class Rotation:
    """How k models turn to each other.

    Attributes:
        C: (k, 3, 3) from each model's axes to the first one's.
        sigma: (k,) standard deviation of the turn of C [rad]; 0 for the first.
        rms: of the attitudes about the motion [rad]; of a robust fit what the median says of it.
        inertia: (3, 3) in the first one's axes, of determinant 1.
        motion: of the body, in the first one's axes.
    """

    C: np.ndarray
    sigma: np.ndarray
    rms: float
    inertia: np.ndarray
    motion: FreeRotation


def fit_rotation(pieces: Sequence[Piece], robust: bool = False, about: FreeRotation | None = None) -> Rotation:
    """Free rotation through the attitudes of all pieces, of two or more images each.

    Args:
        robust: some attitudes are astray.
        about: a motion that is near, in the first piece's axes; without one, rates are drawn on straight between the pieces.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation as Turn

    motion = _Motion(pieces, about)
    first, reach = motion.start(), motion.reach()
    around = np.where(np.arange(len(first)) < 6, first, 0.0)
    fitted = partial(
        least_squares,
        lambda x: motion.residuals(x[None])[0],
        jac=motion.slope,
        bounds=(around - reach, around + reach),
        x_scale=reach,
        max_nfev=60,
        ftol=1e-8,
    )
    solution = fitted(first)
    if robust:
        solution = fitted(solution.x, loss="soft_l1", f_scale=OUTLYING_RAD)
    count = 3 * sum(len(p.times) for p in pieces)
    off = solution.fun[:count]
    if robust:
        rms = mad_sigma(off)
    else:
        rms = float(np.sqrt(np.sum(off**2) / max(count - 6 - 3 * (len(pieces) - 1), 1)))
    covariance = np.linalg.pinv(solution.jac.T @ solution.jac) * max(rms, LEAST_SIGMA) ** 2
    C, sigma = [np.eye(3)], [0.0]
    for k in range(1, len(pieces)):
        turn_columns = _turn_of(k)
        C.append(Turn.from_rotvec(solution.x[turn_columns]).as_matrix() @ motion.C[k])
        sigma.append(float(np.sqrt(np.linalg.eigvalsh(covariance[turn_columns, turn_columns])[-1])))
    return Rotation(
        np.array(C),
        np.array(sigma),
        rms,
        inertia_of_log(solution.x[None, 6:11])[0],
        motion.guess.changed(solution.x[:11]),
    )


def _turn_of(k: int) -> slice:
    return slice(8 + 3 * k, 11 + 3 * k)


class _Motion:
    """The attitudes of pieces as a function of: turn and rate (3 + 3) of the body at the first time, logarithm of its inertia (5),
    and turn of each piece but the first (3 each), about a first guess."""

    def __init__(self, pieces: Sequence[Piece], about: FreeRotation | None = None) -> None:
        self.pieces = pieces
        self.times = np.unique(np.concatenate([p.times for p in pieces]))
        begin, unit = float(self.times[0]), float(np.median(np.diff(self.times)))
        self.at = [np.searchsorted(self.times, p.times) for p in pieces]
        if about is None:
            P0, self.w0, self.C = _begin(pieces, (self.times - begin) / unit, self.at)
        else:
            P0, self.w0, self.C = _begin_about(pieces, about, begin + 0.01 * unit * np.arange(2))
        # rate and inertia are all in the parameters
        self.guess = FreeRotation(P0, np.zeros(3), np.zeros(5), begin, unit)
        self.inertia = np.zeros(5) if about is None else about.inertia

    def start(self) -> np.ndarray:
        """As guessed; without a motion that is near, a sphere's inertia."""
        return np.concatenate([np.zeros(3), self.w0, self.inertia, np.zeros(3 * (len(self.pieces) - 1))])

    def reach(self) -> np.ndarray:
        """How far the parameters may be from there: beyond, a step of the fit runs into rates that take for ever."""
        rate = 1.5 * float(np.linalg.norm(self.w0))
        turns = np.full(3 * (len(self.pieces) - 1), MOST_TURN)
        return np.concatenate([np.full(3, MOST_TURN), np.full(3, rate), np.full(5, MOST_LOG), turns])

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(m, r) of parameters (m, p): attitudes off the motion [rad], and the inertia off a sphere's; no numbers where no motion has such
        parameters, from which a fit steps back."""
        from scipy.spatial.transform import Rotation as Turn

        m = len(x)
        P = self.guess.attitudes(self.times, x[:, :11]).transpose(1, 0, 2, 3)
        out = []
        for k, piece in enumerate(self.pieces):
            turned = np.tile(np.eye(3), (m, 1, 1)) if k == 0 else Turn.from_rotvec(x[:, _turn_of(k)]).as_matrix()
            fitted = P[self.at[k]] @ (turned @ self.C[k])
            off = np.einsum("nmji,njl->nmil", fitted, piece.R).reshape(-1, 3, 3)
            turn, known = np.full((len(off), 3), np.nan), np.isfinite(off).all(axis=(1, 2))
            turn[known] = Turn.from_matrix(off[known]).as_rotvec() if known.any() else 0.0
            out.append(turn.reshape(len(piece.times), m, 3))
        attitude = np.concatenate(out).transpose(1, 0, 2).reshape(m, -1)
        return np.concatenate([attitude, LEAST_SIGMA / PRIOR * x[:, 6:11]], axis=1)

    def slope(self, x: np.ndarray) -> np.ndarray:
        """(r, p) derivatives, by differences."""
        step = 1e-5 * np.eye(len(x))
        both = self.residuals(np.concatenate([x + step, x - step]))
        return np.nan_to_num((both[: len(x)] - both[len(x) :]) / 2e-5).T


def _begin(
    pieces: Sequence[Piece], clock: np.ndarray, at: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A first guess: the rates in the camera's axes, drawn on straight between the pieces; P0 (3, 3) and w0 (3,) of the body
    at the first time, in the first piece's axes, and C (k, 3, 3)."""
    from scipy.spatial.transform import Rotation as Turn

    middle, rate = [], []
    for p, i in zip(pieces, at, strict=True):
        turn = Turn.from_matrix(p.R[1:] @ p.R[:-1].transpose(0, 2, 1)).as_rotvec()
        middle.append(0.5 * (clock[i][1:] + clock[i][:-1]))
        rate.append(turn / np.diff(clock[i])[:, None])
    when = np.concatenate(middle)
    order = np.argsort(when)
    known = np.concatenate(rate)[order]
    between = 0.5 * (clock[1:] + clock[:-1])
    drawn = np.column_stack([np.interp(between, when[order], known[:, a]) for a in range(3)])
    steps = Turn.from_rotvec(drawn * np.diff(clock)[:, None]).as_matrix()
    S = [np.eye(3)]
    for step in steps:
        S.append(step @ S[-1])
    S = np.array(S)
    # camera axes at the first time to those at each: the first piece's middle image is where it is
    m = len(at[0]) // 2
    P0 = S[at[0][m]].T @ pieces[0].R[m]
    P = S @ P0
    C = [np.eye(3)]
    for p, i in zip(pieces[1:], at[1:], strict=True):
        C.append(Turn.from_matrix(P[i].transpose(0, 2, 1) @ p.R).mean().as_matrix())
    return P0, P0.T @ drawn[0], np.array(C)


def _begin_about(
    pieces: Sequence[Piece], about: FreeRotation, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `_begin`, by a motion; first (2,): the first time and one soon after."""
    from scipy.spatial.transform import Rotation as Turn

    P0, P1 = about.attitudes(first)[0]
    step = (first[1] - first[0]) / about.unit
    C = [np.eye(3)]
    for p in pieces[1:]:
        apart = about.attitudes(p.times)[0].transpose(0, 2, 1) @ p.R
        apart = apart[np.isfinite(apart).all(axis=(1, 2))]
        C.append(Turn.from_matrix(apart).mean().as_matrix() if len(apart) else np.eye(3))
    return P0, Turn.from_matrix(P0.T @ P1).as_rotvec() / step, np.array(C)


BASIS = np.array(
    [
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6),
        *(
            [[[0, 1, 0], [1, 0, 0], [0, 0, 0]], [[0, 0, 1], [0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0, 1], [0, 1, 0]]]
            / np.sqrt(2)
        ),
    ]
)
"""(5, 3, 3) symmetric matrices without trace, of unit length."""


def inertia_of_log(x: np.ndarray) -> np.ndarray:
    """(m, 3, 3) of determinant 1 from its logarithm (m, 5)."""
    w, v = np.linalg.eigh(np.einsum("mk,kij->mij", x, BASIS))
    return np.einsum("mik,mk,mjk->mij", v, np.exp(w), v)


@dataclass(frozen=True)
class Placement:
    """Where k models lie in the first one: x -> scale C x + shift.

    Attributes:
        scale: (k,); sigma: (k,) its relative standard deviation.
        shift: (k, 3).
        centre: (3,) of mass, in the first one.
        rms: of the centre of mass about its line, in units of the distance.
    """

    scale: np.ndarray
    sigma: np.ndarray
    shift: np.ndarray
    centre: np.ndarray
    rms: float


def fit_centres(pieces: Sequence[Piece], rotation: Rotation, slimness: float) -> Placement:
    """The centre of mass of every piece on one straight line in the camera, passed evenly.

    Linear in the scales s, the centres s c of each piece, and place and velocity on the line: s (R c + t) = p + v time.

    Args:
        slimness: size of the body over its distance: how much less a shift along the line of sight shows than one across.
    """
    times = np.concatenate([p.times for p in pieces]).astype(float)
    unit = float(np.ptp(times)) or 1.0
    k = len(pieces)
    rows, right = [], []
    middle = float(np.mean(times))
    for j, p in enumerate(pieces):
        z = np.median(p.t[:, 2])
        first = float(np.median(pieces[0].t[:, 2]))
        for time, R, t in zip(p.times, p.R, p.t, strict=True):
            # across the line of sight, and along it, in units of the distance
            x, y = t[0] / t[2], t[1] / t[2]
            W = np.array([[1, 0, -x], [0, 1, -y], [0, 0, slimness]]) / first
            row = np.zeros((3, 6 + 3 * k + k - 1))
            row[:, :3], row[:, 3:6] = -W, -W * (time - middle) / unit
            # lengths of piece j in those of the first by the ratio of their distances, nearly
            row[:, 6 + 3 * j : 9 + 3 * j] = W @ R * (first / z)
            if j:
                row[:, 6 + 3 * k + j - 1] = W @ t * (first / z)
            rows.append(row)
            right.append(-W @ t if j == 0 else np.zeros(3))
    A, b = np.concatenate(rows), np.concatenate(right)
    x, *_ = np.linalg.lstsq(A, b, rcond=None)
    rms = float(np.sqrt(np.mean((A @ x - b) ** 2)))
    covariance = np.linalg.pinv(A.T @ A) * rms**2
    first = float(np.median(pieces[0].t[:, 2]))
    scale, sigma, shift = [1.0], [0.0], [np.zeros(3)]
    centre = x[6:9]
    for j in range(1, k):
        at = 6 + 3 * k + j - 1
        z = float(np.median(pieces[j].t[:, 2]))
        s = x[at] * first / z
        c = x[6 + 3 * j : 9 + 3 * j] * first / z
        scale.append(float(s))
        sigma.append(float(np.sqrt(covariance[at, at]) / abs(x[at])))
        shift.append(centre - rotation.C[j] @ c)
    return Placement(np.array(scale), np.array(sigma), np.array(shift), centre, rms)
