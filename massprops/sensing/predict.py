"""What cameras, range finder, gyroscope and attitude sensor would say of a given motion, under any sensing effects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.dynamics.translation import in_rows
from massprops.geometry.vectors import skew
from massprops.sensing.pinhole import Pinhole

STEP = 1e-30
"""Complex step: so small that its square vanishes."""


@dataclass(frozen=True)
class Sensed:
    """Sensing effects and the slice of each in the flat vector of their parameters."""

    effects: tuple[ModuleType, ...] = ()
    places: tuple[slice, ...] = ()

    def __iter__(self) -> Iterator[tuple[ModuleType, slice]]:
        return iter(zip(self.effects, self.places, strict=True))

    def hooks(self, function: str) -> list[tuple[ModuleType, slice]]:
        """Those effects that have a function of that name."""
        return [(e, s) for e, s in self if hasattr(e, function)]


@dataclass(frozen=True)
class Motion:
    """The target's motion at n times: R (n, 3, 3) body to inertial, w (n, 3), r, v (n, 3) of the centre of mass in
    inertial axes, turn (n, 3, 3) inertial to cam0, times (n,)."""

    times: np.ndarray
    R: np.ndarray
    w: np.ndarray
    r: np.ndarray
    v: np.ndarray
    turn: np.ndarray

    @property
    def attitude(self) -> np.ndarray:
        """(n, 3, 3) body axes to cam0's."""
        return self.turn @ self.R


@dataclass(frozen=True)
class Seen:
    """o observations of features: epoch, camera, feature (o,), row (o,) from -0.5 at the top to 0.5 at the bottom."""

    epoch: np.ndarray
    camera: np.ndarray
    feature: np.ndarray
    row: np.ndarray


def camera_turn(motion: Motion, sensed: Sensed, p: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inertial axes to cam0's, with what the chaser turns besides."""
    C = motion.turn
    for effect, place in sensed.hooks("turn"):
        x = in_rows(effect.turn(motion.times, p[place]), len(motion.times))
        C = np.swapaxes(rotation_matrix(from_rotation_vector(x)), -1, -2) @ C
    return C


def delays(seen: Seen, sensed: Sensed, p: np.ndarray) -> np.ndarray | None:
    """(o,) seconds after the timestamp, or None when no effect delays."""
    hooks = sensed.hooks("delay")
    return sum(e.delay(seen.camera, seen.row, p[s]) for e, s in hooks) if hooks else None


def in_chaser(
    seen: Seen, motion: Motion, points: np.ndarray, sensed: Sensed, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Points (o, 3) in cam0's frame; the same points from the centre of mass in body axes at the time of their row;
    the delays. `points` (o, 3) are in body axes."""
    late = delays(seen, sensed, p)
    X = points
    if late is not None:
        X = (rotation_matrix(from_rotation_vector(motion.w[seen.epoch] * late[:, None])) @ X[..., None])[..., 0]
    Y = (motion.R[seen.epoch] @ X[..., None])[..., 0] + motion.r[seen.epoch]
    if late is not None:
        Y = Y + motion.v[seen.epoch] * late[:, None]
    C = camera_turn(motion, sensed, p)
    return (C[seen.epoch] @ Y[..., None])[..., 0], X, late


def image(cameras: tuple[Pinhole, ...], camera: np.ndarray, X: np.ndarray, sensed: Sensed, p: np.ndarray) -> np.ndarray:
    """Pixels (o, 2) of points X (o, 3) in cam0's frame; a point behind its camera is moved to a depth of 1 mm."""
    out = np.zeros((len(X), 2), np.result_type(X, p, float))
    for k, pinhole in enumerate(cameras):
        of_camera = camera == k
        if not of_camera.any():
            continue
        base = pinhole.t
        for effect, place in sensed.hooks("base"):
            base = effect.base(k, base, p[place])
        Y = (X[of_camera] - base) @ pinhole.R.T
        depth = np.where(np.real(Y[:, 2]) > 1e-3, Y[:, 2], 1e-3)
        x, y = Y[:, 0] / depth, Y[:, 1] / depth
        fu, fv, cu, cv = pinhole.intrinsics
        for effect, place in sensed.hooks("lens"):
            x, y = effect.lens(x, y, p[place], fu)
        out[of_camera, 0], out[of_camera, 1] = fu * x + cu, fv * y + cv
    return out


def pixels(
    cameras: tuple[Pinhole, ...], seen: Seen, motion: Motion, points: np.ndarray, sensed: Sensed, p: np.ndarray
) -> np.ndarray:
    """Pixels (o, 2) of body points (o, 3)."""
    return image(cameras, seen.camera, in_chaser(seen, motion, points, sensed, p)[0], sensed, p)


@dataclass(frozen=True)
class PixelJacobian:
    """Pixels (o, 2) and derivatives by: turn (o, 2, 3) of the body about its axes, rate (o, 2, 3), place (o, 2, 3),
    velocity (o, 2, 3), point (o, 2, 3), effect parameters (o, 2, s)."""

    uv: np.ndarray
    turn: np.ndarray
    rate: np.ndarray | None
    place: np.ndarray
    velocity: np.ndarray | None
    point: np.ndarray
    effect: np.ndarray


def pixel_jacobian(
    cameras: tuple[Pinhole, ...], seen: Seen, motion: Motion, points: np.ndarray, sensed: Sensed, p: np.ndarray
) -> PixelJacobian:
    """`pixels` with its derivatives; points (o, 3) in body axes, p (s,) parameters of the effects."""
    X, body, late = in_chaser(seen, motion, points, sensed, p)
    uv = image(cameras, seen.camera, X, sensed, p)
    G = np.empty((len(X), 2, 3))
    for j in range(3):
        moved = X.astype(complex)
        moved[:, j] += 1j * STEP
        G[:, :, j] = np.imag(image(cameras, seen.camera, moved, sensed, p)) / STEP
    C = camera_turn(motion, sensed, p)
    H = G @ C[seen.epoch]
    HR = H @ motion.R[seen.epoch]
    turned = -(HR @ skew(body))
    effect = np.zeros((len(X), 2, len(p)))
    for j in range(len(p)):
        moved = p.astype(complex)
        moved[j] += 1j * STEP
        effect[:, :, j] = np.imag(pixels(cameras, seen, motion, points, sensed, moved)) / STEP
    if late is None:
        return PixelJacobian(uv, turned, None, H, None, HR, effect)
    by_point = HR @ rotation_matrix(from_rotation_vector(motion.w[seen.epoch] * late[:, None]))
    wait = late[:, None, None]
    return PixelJacobian(uv, turned, turned * wait, H, H * wait, by_point, effect)
