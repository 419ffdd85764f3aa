"""Tumbling bodies by textbook formulas alone: nothing here comes from the package that is tested.

Torques in N m, inertia in kg m^2, angular momentum in N m s, on a body of some kilograms. Motion by scipy's DOP853, a plain pinhole,
and files written by hand after the description of the sequence folder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

MU = 3.986004418e14


@dataclass(frozen=True)
class World:
    """One body, one chaser, and what acts.

    `falls`: the target moves as the planet pulls it beside the chaser; otherwise straight on.
    `effects`: name to numbers in the unit of the textbook; see `_torque`, `_cameras_see` and `wrong_by`.
    """

    seed: int
    inertia: np.ndarray
    w0: np.ndarray
    attitude: Rotation
    place: np.ndarray
    velocity: np.ndarray
    points: np.ndarray
    times: np.ndarray
    focal: float
    size: tuple[int, int]
    baseline: float
    sigma_px: float
    outliers: float
    missing: float
    range_sigma: float
    attitude_sigma: float
    rate_sigma: float
    tracks: bool
    sun: np.ndarray
    magnetic: np.ndarray
    orbit_radius: float
    falls: bool
    effects: dict[str, np.ndarray] = field(default_factory=dict)


def drawn(seed: int, sensors: str) -> World:
    """A body and its chaser: rates of 0.5 to 30 deg/s, 1 to 10 m, 10 to 100 m away, 1 to 30 Hz, 200 to 600 frames."""
    rng = np.random.default_rng([seed, 501])
    while True:
        speed = np.radians(np.exp(rng.uniform(np.log(0.5), np.log(30.0))))
        hertz = float(rng.choice([1, 2, 5, 10, 15, 30]))
        frames = int(rng.integers(200, 601))
        turn, whole = speed / hertz, speed * frames / hertz
        if np.radians(0.4) < turn < np.radians(10) and whole > np.radians(300):
            break
    length = float(np.exp(rng.uniform(0, np.log(10.0))))
    width, height = [(1280, 1024), (1920, 1080), (2048, 2048), (1024, 768)][rng.integers(4)]
    while True:
        distance = float(np.exp(rng.uniform(np.log(10.0), np.log(100.0))))
        focal = float(np.exp(rng.uniform(np.log(600.0), np.log(4000.0))))
        if 0.08 * height < focal * 0.5 * length / distance < 0.4 * height and length < 0.5 * distance:
            break
    sides = np.sort(rng.uniform(0.3, 1.0, 3))
    while min(np.diff(sides)) < 0.12:
        sides = np.sort(rng.uniform(0.3, 1.0, 3))
    sides *= length / sides[-1]
    mass = 200.0 * float(np.prod(sides))
    box = mass / 12.0 * np.diag(sides[[1, 0, 0]] ** 2 + sides[[2, 2, 1]] ** 2)
    axes = Rotation.random(rng=rng).as_matrix()
    spin = rng.standard_normal(3) + [0.5, 0.8, 0.5]
    points = rng.uniform(-0.5, 0.5, (int(rng.integers(10, 21)), 3))
    side = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), side] = rng.choice([-0.5, 0.5], len(points))
    stereo = sensors == "stereo"
    return World(
        seed,
        axes @ box @ axes.T,
        axes @ (spin / np.linalg.norm(spin) * speed),
        Rotation.random(rng=rng),
        np.array([*rng.uniform(-0.03, 0.03, 2) * distance, distance]),
        rng.standard_normal(3) * 0.02 * length / (frames / hertz),
        (points * sides) @ axes.T,
        np.arange(frames) / hertz,
        focal,
        (width, height),
        float(rng.uniform(0.04, 0.12)) * distance if stereo else 0.0,
        float(rng.choice([0.2, 0.3, 0.5])),
        float(rng.choice([0.0, 0.005])),
        float(rng.choice([0.0, 0.1])),
        0.02 if sensors == "range" or (stereo and rng.random() < 0.5) else 0.0,
        2e-3 if sensors != "stereo" else 0.0,
        0.01 * speed if sensors == "rates" else 0.0,
        sensors != "rates",
        _unit(rng.standard_normal(3)),
        3e-5 * _unit(rng.standard_normal(3)),
        6.9e6,
        bool(rng.random() < 0.5),
    )


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def wrong_by(world: World, name: str) -> np.ndarray:
    """Numbers of an effect in its textbook form, of a size to be scaled."""
    rng = np.random.default_rng([world.seed, 502])
    mean = np.trace(world.inertia) / 3.0
    speed, span = np.linalg.norm(world.w0), world.times[-1]
    torque = mean * speed / span
    way = _unit(rng.standard_normal(3))
    sign = float(rng.choice([-1, 1]))
    middle = span * rng.uniform(0.25, 0.75)
    return {
        "constant-body-torque": 0.1 * torque * way,
        "viscous-damping": np.array([0.1 * mean / span]),
        "eddy-current-torque": np.array([0.1 * mean / span / 9e-10]),
        "solar-radiation-torque": 0.1 * torque * way,
        "magnetic-dipole-torque": 0.1 * torque / 3e-5 * way,
        "gravity-gradient-torque": np.array([1.0]),
        "energy-dissipation": np.array([0.05 * mean, 0.05 * mean * speed * rng.uniform(0.3, 1.0)]),
        "internal-rotor": 0.05 * mean * speed * way,
        "impulse": np.concatenate([[middle], 0.05 * mean * speed * way, 0.01 * rng.standard_normal(3)]),
        "inertia-change": np.concatenate([[middle], 0.1 * way, [0.05]]),
        "nonuniform-density": np.concatenate([way, [0.05]]),
        "lens-distortion": np.array([sign * 0.1, 0.0]),
        "focal-length-error": np.array([sign * 0.01]),
        "baseline-error": np.array([sign * 0.01]),
        "stereo-time-offset": np.array([sign * 0.1 / speed]),
        "chaser-rotation-drift": 1e-3 / span * way,
        "rolling-shutter": np.array([0.5 * (world.times[1] - world.times[0])]),
        "range-bias": np.array([sign * 0.1]),
    }[name]


SCALED = {"impulse": slice(1, None), "energy-dissipation": slice(0, 2), "inertia-change": slice(4, 5),
          "nonuniform-density": slice(3, 4)}  # fmt: skip
"""Numbers that grow with the effect, where not all do."""


def sized(world: World, name: str, pixels: float) -> World:
    """The world with an effect that moves the tracks by `pixels` rms (attitudes by a tenth of a degree for each pixel
    where there are no tracks)."""
    numbers = wrong_by(world, name)
    if name == "gravity-gradient-torque":
        return replace(world, effects={**world.effects, name: numbers})
    grows = SCALED.get(name, slice(None))
    period = world.times[1]
    most = {
        "rolling-shutter": period,
        "stereo-time-offset": 2 * period,
        "lens-distortion": 0.5,
        "focal-length-error": 0.1,
    }
    for _ in range(7):
        moved = _moved(world, replace(world, effects={**world.effects, name: numbers}))
        if not 1e-6 < moved < np.inf or abs(np.log(moved / pixels)) < 0.02:
            break
        numbers = numbers.copy()
        numbers[grows] *= np.clip(pixels / moved, 0.05, 20.0)
    if name in most:
        numbers = np.clip(numbers, -most[name], most[name])
    return replace(world, effects={**world.effects, name: numbers})


def _moved(world: World, other: World) -> float:
    a, b = motion(world), motion(other)
    if not world.tracks:
        off = (a.body_to_inertial.inv() * b.body_to_inertial).magnitude()
        return float(np.degrees(np.sqrt(np.mean(off**2))) * 10.0)
    ua, _ = _cameras_see(world, a)
    ub, _ = _cameras_see(other, b)
    both = np.isfinite(ua).all(axis=-1) & np.isfinite(ub).all(axis=-1)
    return float(np.sqrt(np.mean(np.sum((ua - ub)[both] ** 2, axis=-1))))


@dataclass(frozen=True)
class Motion:
    """body_to_inertial (n), w (n, 3) body axes, place and speed (n, 3) of the centre of mass."""

    body_to_inertial: Rotation
    w: np.ndarray
    place: np.ndarray
    speed: np.ndarray


def orbit_position(world: World, t: float) -> np.ndarray:
    """Circular orbit in the plane of the first two inertial axes."""
    angle = np.sqrt(MU / world.orbit_radius**3) * t
    return world.orbit_radius * np.array([np.cos(angle), np.sin(angle), 0.0])


def _torque(world: World, t: float, R: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """External torque [N m], body axes. R: body to inertial."""
    total = np.zeros(3)
    e = world.effects
    if "constant-body-torque" in e:
        total += e["constant-body-torque"]
    if "viscous-damping" in e:
        total -= e["viscous-damping"][0] * w
    field_body = R.T @ world.magnetic
    if "eddy-current-torque" in e:
        # charges in the turning body feel w x B; the currents feel the field again
        total += e["eddy-current-torque"][0] * np.cross(np.cross(w, field_body), field_body)
    if "magnetic-dipole-torque" in e:
        total += np.cross(e["magnetic-dipole-torque"], field_body)
    if "solar-radiation-torque" in e:
        # the force points away from the Sun and acts at a lever
        total += np.cross(e["solar-radiation-torque"], -(R.T @ world.sun))
    if "gravity-gradient-torque" in e:
        r = R.T @ orbit_position(world, t)
        d = np.linalg.norm(r)
        total += 3.0 * MU / d**5 * np.cross(r, inertia @ r)
    return total


def true_inertia(world: World, late: bool = False) -> np.ndarray:
    """[kg m^2] before or after a change."""
    inertia = world.inertia
    mean = np.trace(inertia) / 3.0
    if "nonuniform-density" in world.effects:
        # a point mass at a lever from the centre, its second moment a share of the mean moment
        *way, share = world.effects["nonuniform-density"]
        n = _unit(np.array(way))
        inertia = inertia + share * mean * (np.eye(3) - np.outer(n, n))
    if late and "inertia-change" in world.effects:
        _, *way, share = world.effects["inertia-change"]
        n = _unit(np.array(way))
        # booms run out both ways along n: the centre of mass stays
        inertia = inertia + share * mean * (np.eye(3) - np.outer(n, n))
    return inertia


def motion(world: World) -> Motion:
    """Euler's equations with a damper sphere and a wheel: total angular momentum in inertial axes is what torques change."""
    e, t = world.effects, world.times
    wheel = e.get("internal-rotor", np.zeros(3))
    sphere, friction = e.get("energy-dissipation", np.zeros(2))
    ends = sorted({t[0], t[-1], *(e[n][0] for n in ("impulse", "inertia-change") if n in e)})

    def rate(inertia: np.ndarray, s: np.ndarray) -> np.ndarray:
        R = Rotation.from_quat(s[:4]).as_matrix()
        inner = sphere * s[7:10]
        return np.linalg.solve(inertia, R.T @ s[4:7] - inner - wheel)

    def slope(inertia: np.ndarray) -> Callable:
        def f(at: float, s: np.ndarray) -> np.ndarray:
            R = Rotation.from_quat(s[:4]).as_matrix()
            w = rate(inertia, s)
            x, y, z, c = s[:4]
            a, b, g = w
            q = 0.5 * np.array(
                [c * a + y * g - z * b, c * b + z * a - x * g, c * g + x * b - y * a, -x * a - y * b - z * g]
            )
            inner = friction / sphere * (w - s[7:10]) - np.cross(w, s[7:10]) if sphere else np.zeros(3)
            return np.concatenate([q, R @ _torque(world, at, R, w, inertia), inner])

        return f

    inertia = true_inertia(world)
    R0 = world.attitude.as_matrix()
    start = R0 @ (inertia @ world.w0 + sphere * world.w0 + wheel)
    s = np.concatenate([world.attitude.as_quat(), start, world.w0])
    out = np.empty((len(t), 10))
    rates = np.empty((len(t), 3))
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        inside = (t >= a) & (t <= b) if a == t[0] else (t > a) & (t <= b)
        last = float(b)
        done = solve_ivp(
            slope(inertia),
            (a, last),
            s,
            "DOP853",
            t[inside].tolist() + ([] if last in t else [last]),
            rtol=1e-9,
            atol=1e-12,
        )
        out[inside] = done.y.T[: inside.sum()]
        rates[inside] = [rate(inertia, x) for x in out[inside]]
        s = done.y[:, -1].copy()
        if "impulse" in e and b == e["impulse"][0]:
            s[4:7] += Rotation.from_quat(s[:4]).as_matrix() @ e["impulse"][1:4]
        if "inertia-change" in e and b == e["inertia-change"][0]:
            inertia = true_inertia(world, True)
    place = world.place + t[:, None] * world.velocity
    speed = np.broadcast_to(world.velocity, (len(t), 3)).copy()
    if world.falls:
        place, speed = _fallen(world)
    if "impulse" in e:
        after = np.maximum(t - e["impulse"][0], 0)[:, None]
        place = place + after * e["impulse"][4:7]
        speed[after[:, 0] > 0] += e["impulse"][4:7]
    return Motion(Rotation.from_quat(out[:, :4]), rates, place, speed)


def _fallen(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Path beside a chaser on a circular orbit: the difference of the two pulls of the planet."""

    def slope(t: float, s: np.ndarray) -> np.ndarray:
        chaser = orbit_position(world, t)
        target = chaser + s[:3]
        pull = -MU * (target / np.linalg.norm(target) ** 3 - chaser / np.linalg.norm(chaser) ** 3)
        return np.concatenate([s[3:], pull])

    start = np.concatenate([world.place, world.velocity])
    done = solve_ivp(slope, (world.times[0], world.times[-1]), start, "DOP853", world.times, rtol=1e-9, atol=1e-9)
    return done.y[:3].T, done.y[3:].T


def _cameras_see(world: World, m: Motion) -> tuple[np.ndarray, Rotation]:
    """Pixels (n, c, p, 2), NaN where a feature looks away or leaves the picture; and how cam0 stands at each time."""
    e, n = world.effects, len(world.times)
    drift = e.get("chaser-rotation-drift", np.zeros(3))
    chaser = Rotation.from_rotvec(world.times[:, None] * drift)
    count = 2 if world.baseline else 1
    width, height = world.size
    out = np.full((n, count, len(world.points), 2), np.nan)
    readout = e.get("rolling-shutter", np.zeros(1))[0]
    for c in range(count):
        wait = np.full(
            (n, len(world.points)), e["stereo-time-offset"][0] if c == 1 and "stereo-time-offset" in e else 0.0
        )
        for _ in range(3 if readout else 1):
            turned = _after(m.body_to_inertial.as_matrix(), m.w, world.points, wait)
            X = turned + m.place[:, None] + wait[..., None] * m.speed[:, None]
            X = np.einsum("nji,npj->npi", chaser.as_matrix(), X)
            base = world.baseline * (1.0 + e.get("baseline-error", np.zeros(1))[0]) * c
            Y = X - [base, 0.0, 0.0]
            x, y = Y[..., 0] / Y[..., 2], Y[..., 1] / Y[..., 2]
            k1, k2 = e.get("lens-distortion", np.zeros(2))
            r2 = x * x + y * y
            bend = 1.0 + k1 * r2 + k2 * r2 * r2
            focal = world.focal * (1.0 + e.get("focal-length-error", np.zeros(1))[0])
            u, v = focal * x * bend + width / 2.0, focal * y * bend + height / 2.0
            if readout:
                wait = readout * (v / height - 0.5)
        outward = np.einsum(
            "nij,pj->npi",
            m.body_to_inertial.as_matrix(),
            world.points / np.linalg.norm(world.points, axis=1, keepdims=True),
        )
        facing = np.sum(outward * (Y / np.linalg.norm(Y, axis=-1, keepdims=True)), axis=-1) < 0.1
        inside = (u > 0) & (v > 0) & (u < width) & (v < height) & (Y[..., 2] > 0.1)
        out[:, c] = np.where((facing & inside)[..., None], np.stack([u, v], axis=-1), np.nan)
    return out, chaser


def _after(R: np.ndarray, w: np.ndarray, points: np.ndarray, wait: np.ndarray) -> np.ndarray:
    """Points in inertial axes a little after the frame, by the rate at the frame."""
    little = Rotation.from_rotvec((w[:, None] * wait[..., None]).reshape(-1, 3)).as_matrix().reshape(*wait.shape, 3, 3)
    return np.einsum("nij,npjk,pk->npi", R, little, points)


def write(world: World, folder: Path, noise_stated: bool = True, environment: bool = True, body: bool = True) -> None:
    """The sequence folder, by hand. The inertia of `body.yaml` is of the even body, ten numbers a tenth of a per cent off."""
    rng = np.random.default_rng([world.seed, 503])
    m = motion(world)
    stamp = np.round(world.times * 1e9).astype(np.int64)
    folder.mkdir(parents=True)

    def table(place: str, head: str, rows: list[str]) -> None:
        (folder / place).mkdir(exist_ok=True)
        (folder / place / "data.csv").write_text(head + "\n" + "\n".join(rows) + "\n")

    see, chaser = _cameras_see(world, m)
    if world.tracks:
        uv = see + world.sigma_px * rng.standard_normal(see.shape)
        wrong = rng.random(see.shape[:3]) < world.outliers
        uv[wrong] += rng.uniform(-50, 50, (int(wrong.sum()), 2))
        uv[rng.random(see.shape[:3]) < world.missing] = np.nan
        n, c, p = np.nonzero(np.isfinite(uv[..., 0]))
        rows = [
            f"{stamp[i]},{k},{j + 5},{uv[i, k, j, 0]:.4f},{uv[i, k, j, 1]:.4f}" for i, k, j in zip(n, c, p, strict=True)
        ]
        table("tracks0", "#timestamp [ns],camera,feature,u [px],v [px]", rows)
        for k in range(see.shape[1]):
            (folder / f"cam{k}").mkdir()
            text = (
                f"sensor_type: camera\nrate_hz: {1 / (world.times[1] - world.times[0]):.6g}\n"
                f"resolution: [{world.size[0]}, {world.size[1]}]\ncamera_model: pinhole\n"
                f"intrinsics: [{world.focal}, {world.focal}, {world.size[0] / 2}, {world.size[1] / 2}]\n"
                "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n"
                f"T_BS:\n  rows: 4\n  cols: 4\n  data: [1, 0, 0, {world.baseline * k}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
            )
            (folder / f"cam{k}" / "sensor.yaml").write_text(
                text + (f"sigma_px: {world.sigma_px}\n" if noise_stated else "")
            )
    if world.range_sigma:
        far = np.linalg.norm(m.place, axis=1) + world.effects.get("range-bias", np.zeros(1))[0]
        far = far + world.range_sigma * rng.standard_normal(len(far))
        table("range0", "#timestamp [ns],range [m]", [f"{s},{r:.5f}" for s, r in zip(stamp, far, strict=True)])
        (folder / "range0" / "sensor.yaml").write_text(f"sensor_type: range\nsigma_m: {world.range_sigma}\n")
    if world.rate_sigma:
        w = m.w + world.rate_sigma * rng.standard_normal(m.w.shape)
        head = "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1]"
        table("imu0", head, [f"{s},{a:.9f},{b:.9f},{g:.9f}" for s, (a, b, g) in zip(stamp, w, strict=True)])
    if world.attitude_sigma:
        q = (
            chaser.inv()
            * m.body_to_inertial
            * Rotation.from_rotvec(world.attitude_sigma * rng.standard_normal((len(stamp), 3)))
        )
        head = "#timestamp [ns],q_w [],q_x [],q_y [],q_z [],sigma [rad]"
        rows = [
            f"{s},{d:.9f},{a:.9f},{b:.9f},{g:.9f},{world.attitude_sigma}"
            for s, (a, b, g, d) in zip(stamp, q.as_quat(), strict=True)
        ]
        table("attitude0", head, rows)
    if body:
        even = world.inertia * 1.0
        err = rng.standard_normal((3, 3)) * 0.001 * np.trace(even) / 3.0
        even = even + 0.5 * (err + err.T)
        numbers = "\n".join(f"  - [{', '.join(f'{v:.9g}' for v in row)}]" for row in even)
        (folder / "body.yaml").write_text(
            f"inertia:\n{numbers}\ninertia_units: kg m^2\nmass_kg: null\ncentre_of_mass_m: null\nsource: CAD\ninertia_sigma: 0.005\n"
        )
    if environment:
        (folder / "environment.yaml").write_text(
            "chaser_attitude: inertial\n"
            f"orbit:\n  mu_m3_s2: {MU}\n  semi_major_axis_m: {world.orbit_radius}\n  eccentricity: 0.0\n  true_anomaly_rad: 0.0\n"
            "  R_inertial_perifocal: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
            f"sun_direction: [{', '.join(f'{v:.9f}' for v in world.sun)}]\n"
            f"magnetic_field_T: [{', '.join(f'{v:.6e}' for v in world.magnetic)}]\n"
        )


def own_axes(world: World, folder: Path, attitude: list[float]) -> np.ndarray | None:
    """(3, 3) from the world's body axes to those of a diagnosis that begins with an attitude (w, x, y, z) of its own; None
    where a body file, an attitude sensor or a gyroscope fixes them."""
    if any((folder / known).exists() for known in ("body.yaml", "attitude0", "imu0")):
        return None
    w, x, y, z = attitude
    return Rotation.from_quat([x, y, z, w]).as_matrix().T @ motion(world).body_to_inertial[0].as_matrix()


def expected(world: World, name: str) -> dict[str, float]:
    """What `diagnosis.json` should say of an effect: torques and momenta over the mean moment of the body."""
    v = world.effects[name]
    mean = np.trace(true_inertia(world)) / 3.0
    xyz = "xyz"
    per_moment = {"constant-body-torque": "torque", "solar-radiation-torque": "pressure", "magnetic-dipole-torque": "dipole",
                  "internal-rotor": "momentum"}  # fmt: skip
    if name in per_moment:
        return {f"{per_moment[name]}_{a}": x / mean for a, x in zip(xyz, v, strict=True)}
    if name == "energy-dissipation":
        return {"share": v[0] / mean, "coupling": v[1] / v[0]}
    if name == "impulse":
        kicks = {f"kick_{a}": x / mean for a, x in zip(xyz, v[1:4], strict=True)}
        return {"time": v[0], **kicks, **{f"velocity_{a}": x for a, x in zip(xyz, v[4:7], strict=True)}}
    if name == "inertia-change":
        change = (true_inertia(world, True) - true_inertia(world)) / mean
        return {
            "time": v[0],
            **{
                f"inertia_{a}{b}": change["xyz".index(a), "xyz".index(b)]
                for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")
            },
        }
    single = {"viscous-damping": ("damping", mean), "eddy-current-torque": ("conductance", mean), "focal-length-error": ("relative", 1.0),
              "baseline-error": ("relative", 1.0), "stereo-time-offset": ("offset", 1.0), "rolling-shutter": ("readout", 1.0),
              "range-bias": ("bias", 1.0), "gravity-gradient-torque": ("strength", 1.0)}  # fmt: skip
    if name in single:
        key, unit = single[name]
        return {key: v[0] / unit}
    if name == "chaser-rotation-drift":
        return {f"rate_{a}": x for a, x in zip(xyz, v, strict=True)}
    if name == "lens-distortion":
        return {"k1": v[0]}
    return {}
