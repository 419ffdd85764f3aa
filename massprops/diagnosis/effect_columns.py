"""What an effect of the catalogue adds to the balance of momentum, as columns that its unknowns multiply.

An effect whose torque is linear in its parameters needs nothing more than its `torque`: its columns are the torques of
unit parameters. So are those of one that is linear in `MOMENTUM_UNKNOWNS` for any values of the others, which
`momentum_scan` tries. Others have the hook

- `momentum_columns(t, R, w, held)`: `torque`, `internal` or `rate` (n, 3, k) in body axes, or `momentum` (n, 3, k) or
  a list of k columns (n, 3) in inertial axes, by name, for unknowns that enter linearly with the parameters in `held` as they are; R (n, 3, 3)
  body to inertial, w (n, 3) body rates;
- `MOMENTUM_UNKNOWNS`: names of the parameters that the columns belong to;
- `momentum_scan(t, w)`: the values of `held` to try: a time, a time constant;
- `momentum_scan_again(t, w)`: others, where those lead to nothing that explains the record;
- `momentum_variants(held, gap)`: others worth a fit once one is found, gap the time between measurements [s];
- `momentum_alike(held)`: others that look nearly the same, such as a simpler form, tried from where the best fit came to;
- `momentum_steps(held, gap)`: by name, the step with which a value that was scanned is moved to its best.

- `momentum_moved(held, unknowns)`: for unknowns that do not enter linearly, whose columns are derivatives about `held`: the values
  that the unknowns lead to, by name, about which the next pass is linearised. Their number may change with `held`;
- `momentum_here(held)`: the unknowns that lead to `held` itself, zeros where it is missing; None where they enter linearly.

- `MOMENTUM_VALLEY`: the one of these that leads along a curved valley of the likelihood, over which the posterior is summed
  (`whole_motion`).

- `unit_torques(t, q, w, environment)`: the torques of a unit of each parameter in turn, where that is quicker than `torque` of each;
- `momentum_prior()`: (k, j) matrix that makes the k parameters of j unknowns which are independent and of one size, where
  physics says more of them together than that each may be anything.

- `momentum_sd(held)`: prior standard deviations of the unknowns where physics says them; else one size of all is found.

- `momentum_log_prior(values)`: log density of the unknowns' values beyond those laws, by which points of a valley are weighed;
- `MOMENTUM_OPEN`: those of the unknowns whose law is about the present value, a guide of the search that has no say in their sigma.

- `can_be(inertia, w, values)`: whether a body of inertia (3, 3) that turns at w (n, 3) can have the values of `MOMENTUM_UNKNOWNS`.

- `BODY`: names of the parameters that belong to the body and are the same in all its records (`common_parameters`);
- `BODY_NUMBERS`: by name, for those that are a number of the body times one of the record: the name of the former, and the latter.

With `parts` in `held` the unknowns come once for each part, and a parameter is their sum.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from massprops.diagnosis.momentum_balance import Forcing, torque_forcing
from massprops.diagnosis.motion_path import MotionPath
from massprops.dynamics.environment import EnvironmentState
from massprops.dynamics.rotation import six_of
from massprops.effect_contract import superposes
from massprops.effects import changes_motion, effects, of_body, places_of


@dataclass(frozen=True, kw_only=True)
class Term:
    """An effect in a hypothesis.

    Attributes:
        effect: its file; held: parameters that are scanned, not solved for, by name. apart: whether several records share nothing
            of it, though the body has it.
    """

    effect: ModuleType
    held: tuple[tuple[str, float], ...] = ()
    apart: bool = False

    @property
    def name(self) -> str:
        return str(self.effect.NAME)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the parameters that the columns belong to."""
        named = getattr(self.effect, "MOMENTUM_UNKNOWNS", None)
        return tuple(named) if named else tuple(q.name for q in self.effect.PARAMETERS)

    @property
    def parts(self) -> int:
        """How many times the unknowns come."""
        return int(dict(self.held).get("parts", 1))

    @property
    def of_body(self) -> tuple[str, ...]:
        """Names of its parameters that belong to the body, not to one record."""
        return () if self.apart else tuple(getattr(self.effect, "BODY", ()))

    def of_body_as(self, name: str) -> tuple[str, float]:
        """What the body's own number is called that one of these parameters tells, and what it is multiplied by in this record."""
        return of_body(self.effect).get(name, (name, 1.0))

    def values(self, unknowns: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (k,) and their covariance (k, k) from all unknowns: their sums over the parts, or by the prior, or where the
        unknowns are steps, what they lead to."""
        now, slopes = self.values_by_unknowns(unknowns, 1e-4 * np.sqrt(np.maximum(np.diag(covariance), 1e-30)))
        return now, slopes @ covariance @ slopes.T

    @property
    def sd(self) -> np.ndarray | None:
        """Prior standard deviations of the unknowns, or None where their size is found."""
        offered = getattr(self.effect, "momentum_sd", None)
        return None if offered is None else np.asarray(offered(dict(self.held)))

    @property
    def moves(self) -> bool:
        """Whether the values that its columns belong to move with every pass."""
        return hasattr(self.effect, "momentum_moved")

    def here(self, count: int) -> np.ndarray | None:
        """(count,) unknowns that lead to the present values, about which the columns are derivatives; None where they enter linearly."""
        if not self.moves:
            return None
        offered = getattr(self.effect, "momentum_here", None)
        return np.zeros(count) if offered is None else offered(dict(self.held))

    def moved(self, unknowns: np.ndarray) -> Term:
        """The effect about the values that the unknowns lead to."""
        return term_of(self.effect, self.effect.momentum_moved(dict(self.held), unknowns))

    def values_by_unknowns(
        self, unknowns: np.ndarray, size: np.ndarray | float = 1e-5
    ) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (k,) from all unknowns (j,), and their derivatives (k, j), over steps of a size where the unknowns are steps."""
        if not self.moves:
            add = np.tile(np.eye(len(self.unknowns)), self.parts) if self.prior is None else self.prior
            return add @ unknowns, add

        def at(x: np.ndarray) -> np.ndarray:
            held = self.effect.momentum_moved(dict(self.held), x)
            return np.array([held[name] for name in self.unknowns])

        now, steps = at(unknowns), np.broadcast_to(size, unknowns.shape)
        return now, np.stack([(at(unknowns + e) - now) / s for e, s in zip(np.diag(steps), steps, strict=True)], axis=1)

    @property
    def prior(self) -> np.ndarray | None:
        """(k, j) what makes the parameters of independent unknowns, or None where they are these."""
        offered = getattr(self.effect, "momentum_prior", None)
        return None if offered is None else np.asarray(offered())


def in_balance() -> list[ModuleType]:
    """The effects of the catalogue that the balance can hold."""
    return [m for m in effects().values() if changes_motion(m) and _has_columns(m)]


def follows_measured(effect: ModuleType) -> bool:
    """Whether the effect follows what was measured beside the motion."""
    return hasattr(effect, "GIVEN")


def has_known_rate(effect: ModuleType) -> bool:
    """Whether the effect is a wheel whose rate was measured, so that none of any history is looked for."""
    return effect.NAME == "internal-rotor" and follows_measured(effect)


def _has_columns(effect: ModuleType) -> bool:
    scanned = hasattr(effect, "torque") and hasattr(effect, "momentum_scan")
    return hasattr(effect, "momentum_columns") or scanned or is_linear(effect)


def is_linear(effect: ModuleType) -> bool:
    """Whether the effect is a torque whose parameters all enter linearly."""
    simple = hasattr(effect, "torque") and not places_of(effect, "time") and not places_of(effect, "pace")
    return simple and superposes(effect)


def scan(effect: ModuleType, t: np.ndarray, w: np.ndarray) -> list[Term]:
    """The effect at every value of what is scanned; t (m,) times [s] and w (m, 3) rates of the measurements."""
    if not hasattr(effect, "momentum_scan"):
        return [Term(effect=effect)]
    return [term_of(effect, held) for held in effect.momentum_scan(t, w)]


def scan_again(effect: ModuleType, t: np.ndarray, w: np.ndarray) -> list[Term]:
    """The effect at other values to begin with, where it offers such; else none."""
    offered = getattr(effect, "momentum_scan_again", None)
    return [] if offered is None else [term_of(effect, held) for held in offered(t, w)]


def looked_at(term: Term, t: np.ndarray, w: np.ndarray) -> int:
    """At how many values an effect was looked for: those scanned, each with its variants in all but time; one where these values are
    unknowns that moved from there."""
    if term.moves:
        return 1
    held, gap = dict(term.held), float(np.median(np.diff(t)))
    forms = {tuple(v for v in other.held if v[0] != "time") for other in (term, *variants(term, gap))}
    return len(scan(term.effect, t, w)) * (len(forms) if held else 1)


def term_of(effect: ModuleType, held: dict[str, float]) -> Term:
    """The effect with these of its values held, by name."""
    return Term(effect=effect, held=tuple(sorted(held.items())))


def variants(term: Term, gap: float) -> list[Term]:
    """Other values of what is scanned that are worth a fit beside these; gap: between measurements [s]."""
    offered = getattr(term.effect, "momentum_variants", None)
    return [] if offered is None else [term_of(term.effect, held) for held in offered(dict(term.held), gap)]


def lookalikes(term: Term) -> list[Term]:
    """The effect at other values that look nearly the same."""
    offered = getattr(term.effect, "momentum_alike", None)
    return [] if offered is None else [term_of(term.effect, held) for held in offered(dict(term.held))]


def steps(term: Term, gap: float) -> dict[str, float]:
    """By name, the step with which a value that was scanned is moved to its best; empty where it stays."""
    offered = getattr(term.effect, "momentum_steps", None)
    return {} if offered is None else dict(offered(dict(term.held), gap))


def forcing_of(term: Term, path: MotionPath, rate: np.ndarray, inertia: np.ndarray, environment: Any = None) -> Forcing:
    """The columns of one effect along a path, of unknowns that are independent (`Term.prior`).

    Args:
        rate: (n, 3) the rate to take where an effect depends on it: predicted, so that it carries no noise.
        inertia: (3, 3) present guess; sky: what acts from outside, or None where nothing is known of it.
    """
    units, prior = _unit_forcing(term, path, rate, inertia, environment), term.prior
    if prior is None:
        return units
    sides = {k: getattr(units, k) for k in ("momentum", "internal", "rate")}
    # as matrices: a product for each point and axis takes ten times as long
    flat = {k: None if v is None else v.reshape(-1, len(prior)) @ prior for k, v in sides.items()}
    return Forcing(**{k: None if v is None else v.reshape(len(path.t), 3, -1) for k, v in flat.items()})


def _unit_forcing(term: Term, path: MotionPath, rate: np.ndarray, inertia: np.ndarray, environment: Any) -> Forcing:
    """The columns of a unit of each parameter."""
    effect = term.effect
    if hasattr(effect, "momentum_columns"):
        parts = effect.momentum_columns(path.t, path.R, rate, dict(term.held))
        if "torque" in parts:
            return torque_forcing(path, parts["torque"])
        return Forcing(**{k: np.stack(v, axis=2) if isinstance(v, list) else v for k, v in parts.items()})
    environment = (
        EnvironmentState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0) if environment is None else environment
    )
    n, six = len(path.t), six_of(inertia)
    q = tuple(path.q.T)
    if hasattr(effect, "unit_torques"):
        units = effect.unit_torques(path.t, q, tuple(rate.T), environment)
        return torque_forcing(path, np.moveaxis(np.array(units), 2, 0).swapaxes(1, 2))
    columns, held = [], dict(term.held)
    for unknown in term.unknowns:
        p = [1.0 if q.name == unknown else held.get(q.name, 0.0) for q in effect.PARAMETERS]
        parts = effect.torque(path.t, q, tuple(rate.T), p, six, environment)
        columns.append(np.stack([np.broadcast_to(x, (n,)) for x in parts], axis=1))
    return torque_forcing(path, np.stack(columns, axis=2))
