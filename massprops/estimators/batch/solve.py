"""Least squares over motion, inertia, effects and feature points, the points eliminated (Schur complement)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massprops.core.levenberg_marquardt import Damping, descend
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.rotation import six_of
from massprops.estimators.batch.track_weights import bounded_square, track_weights, weight_of
from massprops.model.linearise import Linear, Predicted, Residuals, linearise, predict, residuals
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem
from massprops.model.state import BODY_SIZE, INERTIA, BatchState, inertia_directions, log_shape, moved

MOST_ITERATIONS = 40
LARGEST_DAMPING = 1e8
MOST_QUICKENED, MOST_TURNED = 10.0, 100.0
"""Times the first angular velocity, and turn over the record [rad] beside that, beyond which a trial step is wild: its
motion would take for ever to follow."""
PATIENCE = 2
"""Iterations in a row that must say a search is over."""
FIRST_JUDGED = 5
"""Iteration before which no search is held to be lost."""
LONGEST_TIME_STEP = 0.03
"""Of an event's time in one iteration, over the record."""
LARGEST_STEP = 1.0
"""Of the inertia's shape in one iteration, as a change of logarithms."""


@dataclass(frozen=True)
class InertiaPrior:
    """What is believed beforehand: inertia (3, 3) trace 3 with sigma per element over the mean moment, or None;
    weak: otherwise, 1-sigma of the logarithm of the second moment's shape about a ball's, which any data that show the
    inertia outweigh."""

    inertia: np.ndarray | None = None
    sigma: float = 0.05
    weak: float = 1.5


@dataclass(frozen=True)
class Fit:
    """The end of a search.

    Attributes:
        state: where it came to rest; predicted: its motion.
        residuals: of the measurements fitted; weights (k,) robust, 0 for outliers, in the order of `Residuals.norms`.
        information: (f, f) of the free parameters, points eliminated, data only; free: (size,) which those are.
        cost: half the loss of `robust` with the belief; chi2: sum of squares of what was not gated out; count:
            scalars in it; parameters: free parameters and points' coordinates.
        converged: the last step was negligible; iterations.
    """

    state: BatchState
    predicted: Predicted
    residuals: Residuals
    weights: np.ndarray
    information: np.ndarray
    free: np.ndarray
    cost: float
    chi2: float
    count: int
    parameters: int
    converged: bool
    iterations: int

    @property
    def scale(self) -> np.ndarray:
        """(f,) root of the information's diagonal, above 0."""
        return np.sqrt(np.maximum(np.diag(self.information), 1e-100))

    @property
    def unit(self) -> np.ndarray:
        """(f, f) the information in units of its scale."""
        return self.information / self.scale[:, None] / self.scale

    @property
    def freedom(self) -> int:
        """Measurements less parameters."""
        return max(1, self.count - self.parameters)


@dataclass(frozen=True)
class Search:
    """When a search ends.

    Attributes:
        most: iterations. tolerance: of a step, in units of the parameters' 1-sigma.
        idle: fall of the logarithm of the cost times the measurements, per iteration, below which twice in a row it ends.
        against: cost that the search is out to beat: it ends when twice what it gains now would not lead there.
    """

    most: int = MOST_ITERATIONS
    tolerance: float = 1e-3
    idle: float = 0.0
    against: float = np.inf


Place = tuple[BatchState, Predicted, Residuals]
"""A state, what it predicts, and the residuals that leaves."""


@dataclass
class _Descent:
    """Where a search stands: the state, what it predicts, its residuals, their weights and derivatives, and the cost."""

    problem: Problem
    m: Measurements
    environment: EnvironmentModel
    inertia_prior: InertiaPrior
    state: BatchState
    at: Predicted

    def __post_init__(self) -> None:
        self.quickest = MOST_QUICKENED * float(np.linalg.norm(self.state.w0)) + MOST_TURNED / max(
            float(np.ptp(self.problem.times)), 1e-9
        )
        self.renew(self.state, self.at, residuals(self.problem, self.m, self.at))

    def renew(self, state: BatchState, at: Predicted, left: Residuals) -> None:
        """Goes to a state, and linearises there."""
        self.state, self.at = state, at
        self.weights, loss = robust(left, self.m)
        self.linear = linearise(self.problem, self.m, at, self.environment)
        # what the loss is above the weighted squares stays as it is until the weights are renewed
        self.above = loss - weighted_squares(left, self.weights)
        self.cost = self._cost(state, self.linear.residuals)

    def tried(self, trial: BatchState) -> tuple[float, Place]:
        """Cost of a state under the present weights, infinite if it is wild, with what it predicts and its residuals."""
        if not np.linalg.norm(trial.w0) <= self.quickest:
            return np.inf, (trial, self.at, self.linear.residuals)
        with np.errstate(all="ignore"):
            at = predict(self.problem, trial, self.environment)
            trial_residuals = residuals(self.problem, self.m, at)
            return self._cost(trial, trial_residuals), (trial, at, trial_residuals)

    def _cost(self, state: BatchState, left: Residuals) -> float:
        """Half the loss with the prior and the penalties, under the present weights."""
        return 0.5 * (weighted_squares(left, self.weights) + self.above + _beside_data(state, self.inertia_prior))


def fit(
    problem: Problem,
    m: Measurements,
    start: BatchState,
    environment: EnvironmentModel,
    free: np.ndarray,
    inertia_prior: InertiaPrior = InertiaPrior(),
    search: Search = Search(),
) -> Fit:
    """Searches the state that explains the measurements best.

    Args:
        free: (size,) parameters that may move; the others keep their values.
        inertia_prior: about the inertia.
    """
    here = _Descent(problem, m, environment, inertia_prior, start, predict(problem, start, environment))
    size, iterations, stalled, lost, converged = np.inf, 0, 0, 0, False

    def equations(place: Place) -> tuple[float, Reduced]:
        nonlocal iterations
        iterations += 1
        return here.cost, reduced_equations(here.linear, m, here.weights, free, here.state, inertia_prior)

    def step(place: Place, reduced: Reduced, damping: float) -> tuple[float, Place] | None:
        nonlocal size
        d, points = _step(reduced, damping, free, here.state)
        size = reduced.significance(d[free])
        _hold_times(d, here.state, problem)
        new = here.tried(moved(here.state, d, points))
        return None if size < search.tolerance and not new[0] < here.cost else new

    begin = here.state, here.at, here.linear.residuals
    for descent in descend(begin, equations, step, search.most, Damping(lowered=8.0, most=LARGEST_DAMPING)):
        if not descent.fall:
            converged = size < 0.05
            break
        here.renew(*descent.place)
        converged = size < search.tolerance or (descent.fall < 1e-7 * here.cost and descent.damping < 1e-4)
        stalled = stalled + 1 if descent.fall * m.count < search.idle * here.cost else 0
        lost = lost + 1 if here.cost - 2.0 * descent.fall * (search.most - iterations) > search.against else 0
        if converged or stalled == PATIENCE or lost == PATIENCE and iterations >= FIRST_JUDGED:
            break
    return _fit_of(here, free, converged, iterations)


def _fit_of(here: _Descent, free: np.ndarray, converged: bool, iterations: int) -> Fit:
    m, last_residuals = here.m, here.linear.residuals
    weights = robust(last_residuals, m)[0]
    kept = weights > 0
    placed = len(np.unique(m.seen.feature)) if len(m.uv) else 0
    return Fit(
        state=here.state,
        predicted=here.at,
        residuals=last_residuals,
        weights=weights,
        information=reduced_equations(here.linear, m, weights, free, here.state, None).H,
        free=free,
        cost=here.cost,
        chi2=float(np.sum(last_residuals.squares[kept])),
        count=int(np.concatenate([np.full(len(part), part.shape[1]) for part in last_residuals.parts])[kept].sum()),
        parameters=int(free.sum()) + 3 * placed,
        converged=converged,
        iterations=iterations,
    )


def _hold_times(d: np.ndarray, state: BatchState, problem: Problem) -> None:
    """Steps of event times kept short and inside the record: the motion is far from linear in them."""
    first, last = float(problem.times[0]), float(problem.times[-1])
    at = BODY_SIZE
    for module, values in zip(state.model.modules, state.model.values, strict=True):
        for k, q in enumerate(module.PARAMETERS):
            if q.kind == "time":
                longest = LONGEST_TIME_STEP * (last - first)
                d[at + k] = np.clip(d[at + k], -longest, longest)
                d[at + k] = np.clip(values[k] + d[at + k], first, last) - values[k]
        at += len(values)


MEDIANS = (0.83, 0.674, 0.888, 0.888)
"""Median of the norm of each kind of residuals where they are noise of 1-sigma: of two, one, three and three dimensions."""


def spread_of(norms: Sequence[np.ndarray]) -> np.ndarray:
    """(4,) how large the bulk of each kind of residuals is (`Residuals.norms_by_kind`), in units of the noise and never below that: a
    model that lacks something leaves the whole bulk large."""
    kinds = zip(norms, MEDIANS, strict=True)
    return np.array([max(1.0, float(np.median(norm)) / median) if len(norm) else 1.0 for norm, median in kinds])


def robust(r: Residuals, m: Measurements, spread: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Weights, and the loss: the weighted sum of squares, in which an outlier counts as it would at the gate.

    Weights are 1 in the bulk, fall beyond HUBER times its spread, and are 0 beyond GATE times; those of whole tracks fall
    too where tracks may slide. The loss does not fall with them: it would favour the fit that leaves out the most.

    Args:
        spread: (4,) as of `spread_of`, by default that of the residuals.
    """
    norms = r.norms_by_kind
    spread = spread_of(norms) if spread is None else spread
    scaled = [norm / size for norm, size in zip(norms, spread, strict=True)]
    weights = weight_of(np.concatenate(scaled))
    squares = zip(scaled, spread, r.parts, strict=True)
    loss = np.concatenate([bounded_square(x) * size**2 * part.shape[1] for x, size, part in squares])
    if m.may_slide and len(r.tracks):
        tracks, feature = slice(len(r.tracks)), m.seen.feature
        of_tracks, most = track_weights(r.tracks, feature)
        weights[tracks] *= of_tracks
        whole = np.bincount(feature, loss[tracks])[feature]
        loss[tracks] *= np.minimum(1.0, most / np.maximum(whole, 1e-300))
    return weights, float(np.sum(loss))


def costs_alike(fits: Sequence[Fit], m: Measurements) -> np.ndarray:
    """(k,) costs of fits to the same measurements, infinite where a search was lost, with the same spread for all.

    Each has its own by chance, and what its outliers cost goes with the square of that.
    """
    spread = np.min([spread_of(f.residuals.norms_by_kind) for f in fits], axis=0)
    costs = [f.cost + 0.5 * (robust(f.residuals, m, spread)[1] - robust(f.residuals, m)[1]) for f in fits]
    return np.where(np.isfinite(costs), costs, np.inf)


def weighted_squares(r: Residuals, weights: np.ndarray) -> float:
    """The weighted sum of squares without outliers, which may be anything."""
    return float(np.sum(np.where(weights > 0, weights * r.squares, 0.0)))


def _beside_data(state: BatchState, inertia_prior: InertiaPrior) -> float:
    """Sum of squares of the prior and of the effects' penalties."""
    value = np.concatenate([prior_residuals(state, inertia_prior)[0], *(v for _, v, _ in penalties(state))])
    return float(value @ value)


def prior_residuals(state: BatchState, inertia_prior: InertiaPrior | None) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (r,) of the prior over its 1-sigma and their derivatives (r, 5) by the five inertia parameters; r is 0, 5 or 6."""
    if inertia_prior is None:
        return np.zeros(0), np.zeros((0, 5))
    if inertia_prior.inertia is None:
        return -log_shape(state.inertia) / inertia_prior.weak, np.eye(5) / inertia_prior.weak
    value = np.array(six_of(state.inertia - inertia_prior.inertia)) / inertia_prior.sigma
    by_inertia = np.array([six_of(w) for w in inertia_directions(state.inertia)])
    return -value, by_inertia.T / inertia_prior.sigma


def penalties(state: BatchState) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """For each effect with a penalty: its first place among all parameters, the values (r,), and their derivatives (r, k)."""
    out, at = [], BODY_SIZE
    for module, values in zip(state.model.modules, state.model.values, strict=True):
        if hasattr(module, "penalty"):
            numbers = [float(v) for v in values]
            zero = np.array(module.penalty([0.0] * len(numbers)))
            slopes = [
                np.array(module.penalty([float(i == k) for i in range(len(numbers))])) - zero
                for k in range(len(numbers))
            ]
            out.append((at, np.array(module.penalty(numbers)), np.stack(slopes, axis=1)))
        at += len(values)
    return out


@dataclass(frozen=True)
class Reduced:
    """Normal equations without the points: H (f, f), b (f,); what gives the points back."""

    H: np.ndarray
    b: np.ndarray
    V: np.ndarray
    W: np.ndarray
    c: np.ndarray
    full: np.ndarray

    def significance(self, d: np.ndarray) -> float:
        """Length of a step in units of its own uncertainty."""
        return float(np.sqrt(max(0.0, d @ self.H @ d)))


def covariance_of(fitted: Fit, weak: float = 1e3) -> np.ndarray:
    """(size, size) covariance of the parameters, zero for those held, inflated by a misfit; what the data do not show
    gets `weak` times its scale."""
    scale = fitted.scale
    values, vectors = np.linalg.eigh(fitted.unit)
    inverse = (vectors / np.maximum(values, 1.0 / weak**4)) @ vectors.T
    free_covariance = inverse / scale[:, None] / scale * max(1.0, fitted.chi2 / fitted.freedom)
    out = np.zeros((len(fitted.free), len(fitted.free)))
    out[np.ix_(fitted.free, fitted.free)] = free_covariance
    return out


def reduced_equations(
    linear: Linear,
    m: Measurements,
    weights: np.ndarray,
    free: np.ndarray,
    state: BatchState,
    inertia_prior: InertiaPrior | None,
) -> Reduced:
    """The normal equations of a step with the feature points eliminated.

    Args:
        linear: residuals and derivatives over 1-sigma; weights: of each unit of them; free: (size,) bool of `state`'s parameters.
    """
    w = weights[linear.unit]
    J = linear.shared[:, free]
    JW = J * w[:, None]
    full = JW.T @ J
    b = JW.T @ linear.value
    if inertia_prior is not None:
        value, slopes = prior_residuals(state, inertia_prior)
        place = np.flatnonzero(free[INERTIA])
        at = free[: INERTIA.start].sum() + np.arange(len(place))
        full[np.ix_(at, at)] += slopes[:, place].T @ slopes[:, place]
        b[at] += slopes[:, place].T @ value
        for first, off, by_parameters in penalties(state):
            place = np.flatnonzero(free[first : first + by_parameters.shape[1]])
            at = free[:first].sum() + np.arange(len(place))
            full[np.ix_(at, at)] += by_parameters[:, place].T @ by_parameters[:, place]
            b[at] -= by_parameters[:, place].T @ off
    o, count = len(m.uv), len(state.points)
    V, W, c = np.zeros((count, 3, 3)), np.zeros((count, int(free.sum()), 3)), np.zeros((count, 3))
    H = full.copy()
    if o:
        F = linear.point
        Fw = F * weights[:o, None, None]
        order = np.argsort(m.seen.feature, kind="stable")
        who, first = np.unique(m.seen.feature[order], return_index=True)
        V[who] = np.add.reduceat((Fw.transpose(0, 2, 1) @ F)[order], first, axis=0)
        c[who] = np.add.reduceat(
            (Fw.transpose(0, 2, 1) @ linear.residuals.tracks[..., None])[order, :, 0], first, axis=0
        )
        cross = JW[: 2 * o].reshape(o, 2, -1).transpose(0, 2, 1) @ F
        W[who] = np.add.reduceat(cross[order], first, axis=0)
        V += 1e-9 * np.trace(V, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-12 * np.eye(3)
        Vi = np.linalg.inv(V)
        WV = W @ Vi
        H = full - np.einsum("fpi,fqi->pq", WV, W)
        b = b - np.einsum("fpi,fi->p", WV, c)
    return Reduced(0.5 * (H + H.T), b, V, W, c, full)


def _step(reduced: Reduced, damping: float, free: np.ndarray, state: BatchState) -> tuple[np.ndarray, np.ndarray]:
    scale = np.maximum(np.diag(reduced.full), 1e-200)
    H = reduced.H + np.diag((damping + 1e-12) * scale)
    root = np.sqrt(scale)
    try:
        step = np.linalg.solve(H / root[:, None] / root, reduced.b / root) / root
    except np.linalg.LinAlgError:
        step = np.zeros(len(scale))
    d = np.zeros(len(free))
    d[free] = step
    longest = float(np.linalg.norm(d[INERTIA]))
    if not np.isfinite(d).all():
        d[:] = step[:] = 0.0
    elif longest > LARGEST_STEP:
        # the shape of the inertia is linear over a small change only
        d *= LARGEST_STEP / longest
        step = d[free]
    points = state.points
    if len(points):
        back = reduced.c - np.einsum("fpi,p->fi", reduced.W, step)
        V = reduced.V + damping * np.einsum("fii->fi", reduced.V)[:, :, None] * np.eye(3)
        points = points + np.linalg.solve(V + 1e-300, back[..., None])[..., 0]
    return d, points
