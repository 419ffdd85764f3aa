"""The model that simulator, estimators and diagnosis share: a rigid body, its sensors, and a list of effects.

`model.yaml` holds it on disk: `format: massprops-model/1`, `effects: [{name, parameters: {...}, sigma: {...}}]`,
`inertia` (3 x 3, mean moment 1) or null, and what the base model had to be corrected by.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from massprops.core.linalg import consecutive
from massprops.documents.fields import no_key
from massprops.documents.loading import excerpt
from massprops.documents.model import FORMAT
from massprops.dynamics.inertia import is_physical
from massprops.dynamics.rotation import ActiveEffects
from massprops.effect_contract import acts
from massprops.effects import changes_motion, effects, has_pace, of_record
from massprops.errors import InputError
from massprops.sensing.predict import Sensed

LARGEST_PARAMETER = 1e12
"""Of any effect's parameter, in SI units: beyond it the arithmetic of a step overflows."""
MOST_GROWN = 2.0
"""Logarithm of the factor by which a step changes a parameter that moves in proportion."""


@dataclass(frozen=True)
class Model:
    """Which effects act, and with what parameters.

    Attributes:
        modules: the effects, those of the motion first; values: their parameters, one array each.
        inertia: (3, 3) in body axes, mean moment 1, or None when it is to be found.
        rate, attitude: (3,) [rad/s] and (4,) body to inertial axes at the first epoch, or None: where a fit begins.
    """

    modules: tuple[ModuleType, ...] = ()
    values: tuple[np.ndarray, ...] = ()
    inertia: np.ndarray | None = None
    rate: np.ndarray | None = None
    attitude: np.ndarray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(m.NAME for m in self.modules)

    def value(self, name: str) -> np.ndarray:
        """Parameters of one of the effects."""
        return self.values[self.names.index(name)]

    @property
    def active(self) -> ActiveEffects:
        """The effects on the motion."""
        on_motion = [m for m in self.modules if changes_motion(m)]
        return ActiveEffects(tuple(on_motion), _places(on_motion))

    @property
    def sensed(self) -> Sensed:
        """The effects on the sensors."""
        on_sensors = [m for m in self.modules if not changes_motion(m)]
        return Sensed(tuple(on_sensors), _places(on_sensors))

    def flat(self, motion: bool) -> np.ndarray:
        """Parameters of the effects on the motion, or on the sensors, in one vector."""
        chosen = [v for m, v in zip(self.modules, self.values, strict=True) if changes_motion(m) == motion]
        return np.concatenate([np.zeros(0), *chosen])

    def moved(self, motion: np.ndarray, sensing: np.ndarray) -> Model:
        """The same effects with parameters moved by two flat vectors.

        Those of an effect that has a pace move in proportion: size and pace make up for each other, and the long valley of
        the misfit along which they do is straight in their logarithms.
        """
        out, at = [], {True: 0, False: 0}
        for m, value in zip(self.modules, self.values, strict=True):
            kind = changes_motion(m)
            d = (motion if kind else sensing)[at[kind] : at[kind] + len(value)]
            grown = (value > 0) & has_pace(m)
            share = np.divide(d, value, where=grown, out=np.zeros(len(value)))
            out.append(np.where(grown, value * np.exp(np.clip(share, -MOST_GROWN, MOST_GROWN)), value + d))
            at[kind] += len(value)
        return replace(self, values=tuple(out))


def model_of(
    sizes: dict[str, np.ndarray | None], inertia: np.ndarray | None = None, own: Iterable[ModuleType] = ()
) -> Model:
    """A model with effects by name, parameters (k,) each; None starts all of an effect's at zero. inertia: (3, 3) of trace 3.

    Args:
        own: effects in place of the catalogue's of their names.

    Raises:
        InputError: an unknown effect, or the wrong number of parameters.
    """
    known = effects() | {m.NAME: m for m in own}
    for name in sizes:
        if name not in known:
            raise InputError(f"{no_key(name, known, 'effect')}; 'massprops effects' lists them")
    modules = [known[n] for n in known if n in sizes]
    values = []
    for module in modules:
        name = module.NAME
        value, count = sizes[name], len(module.PARAMETERS)
        array = np.zeros(count) if value is None else np.asarray(value, float).reshape(-1)
        if len(array) != count or not np.isfinite(array).all():
            wanted = ", ".join(f"{q.name} [{q.unit}]" for q in module.PARAMETERS)
            raise InputError(f"effect {name}: give {count} finite numbers: {wanted}")
        values.append(array)
    return Model(tuple(modules), tuple(values), inertia)


def lacks(effect: ModuleType, there: set[str]) -> str:
    """What an effect needs and the data lack, in words; empty if nothing."""
    missing = [n for n in effect.NEEDS if n not in there]
    return f"needs {', '.join(missing)}" if missing else ""


def document_of(model: Model, sigma: dict[str, np.ndarray] | None = None) -> dict[str, Any]:
    """What `model.yaml` holds; sigma: by effect, 1-sigma (k,) of its parameters."""
    listed = []
    for name, module, values in zip(model.names, model.modules, model.values, strict=True):
        entry: dict[str, Any] = {
            "name": name,
            "parameters": {q.name: float(v) for q, v in zip(module.PARAMETERS, values, strict=True)},
            "units": {q.name: q.unit for q in module.PARAMETERS},
        }
        if hasattr(module, "GIVEN"):
            entry["given"] = module.GIVEN
        if sigma and name in sigma:
            entry["sigma"] = {q.name: float(s) for q, s in zip(module.PARAMETERS, sigma[name], strict=True)}
        listed.append(entry)
    inertia = None if model.inertia is None else np.asarray(model.inertia).tolist()
    return {"format": FORMAT, "effects": listed, "inertia": inertia}


def load_model(path: str | Path) -> Model:
    """Reads `model.yaml`.

    Raises:
        InputError: not such a file, an unknown effect, or a parameter missing.
    """
    from massprops.documents.fields import Number, read, unread
    from massprops.documents.loading import load_yaml
    from massprops.documents.model import ModelFile

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such model file; 'massprops diagnose' writes one, model.yaml")
    content = load_yaml(path)
    if content.get("format") != FORMAT:
        given_format = excerpt(content.get("format"))
        raise InputError(
            f"{path}: its format is {given_format}, not {FORMAT!r}: give a model.yaml of 'massprops diagnose'"
        )
    document = read(ModelFile, unread(ModelFile, content, str(path))[0], str(path))
    known = effects()
    sizes: dict[str, np.ndarray | None] = {}
    for entry in document.effects or ():
        if entry.name not in known:
            raise InputError(f"{path}: {no_key(entry.name, known, 'effect')}")
        known[entry.name] = _of_entry(known[entry.name], entry.given, path)
        wanted = {q.name: q for q in known[entry.name].PARAMETERS}
        for key in entry.parameters:
            if key not in wanted:
                raise InputError(f"{path}: effect {entry.name}: {no_key(key, wanted, 'parameter')}")
        values = []
        for q in wanted.values():
            if q.kind == "duration" and q.name not in entry.parameters:
                values.append(0.0)
                continue
            try:
                values.append(
                    Number("", q.unit, -LARGEST_PARAMETER, LARGEST_PARAMETER).check(entry.parameters.get(q.name))
                )
            except ValueError as error:
                raise InputError(f"{path}: effect {entry.name}: {q.name} [{q.unit}] {error}") from None
        sizes[entry.name] = np.array(values)
    inertia = document.inertia
    if inertia is not None:
        moments = np.linalg.eigvalsh(inertia)
        if not is_physical(moments, 1e-9):
            moments_text = ", ".join(f"{m:.4g}" for m in moments)
            raise InputError(
                f"{path}: principal moments {moments_text} break the triangle inequality, so no body has them: correct inertia"
            )
    attitude = document.attitude
    if attitude is not None:
        size = float(np.linalg.norm(attitude))
        if not 0.99 < size < 1.01:
            raise InputError(f"{path}: attitude must be a unit quaternion; its length is {size:.3g}")
        attitude = attitude / size
    return replace(model_of(sizes, inertia, known.values()), rate=document.angular_velocity_rad_s, attitude=attitude)


def _of_entry(effect: ModuleType, given: dict[str, Any] | None, path: Path) -> ModuleType:
    """The effect as a file says what was measured beside it, or as it is.

    Raises:
        InputError: it is not that, or the effect does not act without.
    """
    if given is not None:
        try:
            return of_record(effect, given)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    if not acts(effect):
        raise InputError(
            f"{path}: effect {effect.NAME} needs given, which a diagnosis writes: diagnose the record again"
        )
    return effect


def _places(modules: list[ModuleType]) -> tuple[slice, ...]:
    return tuple(consecutive(len(m.PARAMETERS) for m in modules))


__all__ = ["Model", "document_of", "lacks", "load_model", "model_of"]
