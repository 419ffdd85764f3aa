"""The unscented filter: compiled against plain, right answers, honest doubt, features that come and go, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimators.tumbling import images

from massprops.core.compiling import compiled
from massprops.dynamics.quaternion import (
    angle_between,
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    rotation_vector,
)
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.filters import Camera, Measurements, Noise, Settings, State, filter_epochs
from massprops.estimators.filters.features import with_features, without_features
from massprops.estimators.filters.state import KERNEL, Loop
from massprops.estimators.methods import ukf
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess
from massprops.model.problem import Problem
from tests.estimators.unscented_arrays import run_loop

INERTIA = np.diag([90.0, 100.0, 112.0])
K = np.log([0.9, 100 / 112])
W0 = 2 * np.pi * 0.05 * np.array([2.0, 1.0, 2.0]) / 3
RIG = (
    Camera(np.array([800.0, 800, 320, 240]), np.eye(3), np.zeros(3), 480),
    Camera(np.array([800.0, 800, 320, 240]), np.eye(3), np.array([1.0, 0, 0]), 480),
)
SIGMA = 0.1


def motion(n: int, dt: float = 0.5, w0: np.ndarray = W0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = dt * np.arange(n)
    q, w = propagate(np.array([1.0, 0, 0, 0]), w0, INERTIA, t)
    return t, q, w


def stereo(n: int = 240, m: int = 6, seed: int = 0, dt: float = 0.5, velocity: float = 0.004) -> Problem:
    """Tracks of m points by two cameras; cam0's axes are the body's at the start."""
    rng = np.random.default_rng(seed)
    t, q, _ = motion(n, dt)
    p = rng.uniform(-1, 1, size=(m, 3))
    X = np.array([0.3, -0.2, 9.0]) + velocity * t[:, None] * np.array([1.0, 0.5, -0.7])
    uv = images(RIG, q, X, p)
    return problem(t, uv + SIGMA * rng.normal(size=uv.shape))


def problem(t: np.ndarray, uv: np.ndarray, **known: np.ndarray) -> Problem:
    return replace(Problem.of_tracks(t, RIG, uv, SIGMA), **known)


def run(given: Problem):  # type: ignore[no-untyped-def]
    return ukf.estimate(given, Prior(), first_guess(given))


def filter_case(additive: bool, moving: bool, flow: bool, gate: float, n: int = 25, gaps: bool = True):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(3)
    t, q, w = motion(n)
    p = rng.uniform(-1, 1, size=(4, 3))
    r = np.array([0.2, 0.1, 8.0])
    X = r + rotate(q[:, None], p[None])
    V = rotate(q[:, None], np.cross(w[:, None], p[None]))
    per = []
    for c in RIG:
        y = X - c.t
        per.append(800 * y[..., :2] / y[..., 2:] + [320, 240])
    rates = [800 * (V[..., :2] - (X - c.t)[..., :2] / X[..., 2:] * V[..., 2:]) / X[..., 2:] for c in RIG]
    blocks = [*per, (per[1] - per[0])[..., :1], *rates] if flow else per
    z = np.concatenate(blocks, axis=-1)
    z = z + SIGMA * rng.normal(size=z.shape)
    if gaps:
        z[5, 1], z[9:12], z[15, 2, :2] = np.nan, np.nan, np.nan
        z[18, 3, 0] += 40.0
    att = multiply(q, from_rotation_vector(0.01 * rng.normal(size=(n, 3))))
    extra = np.concatenate([np.zeros((n, 3)), w + 1e-3 * rng.normal(size=(n, 3)), np.full((n, 1), 8.0)], axis=1)
    extra[n // 3 : n // 3 + int(gaps), :3] = np.nan
    na = 4 if additive else 3
    N = 5 + na + 3 + (6 if moving else 0) + 12
    sigma = np.concatenate(
        [[0.02] * 3, [0.02] * na, [0.1] * 2, [0.05] * 3, ([0.1] * 3 + [0.01] * 3) * moving, [0.1] * 12]
    )
    mix = rng.normal(size=(N, N)) * 0.1 + np.eye(N)
    P = sigma[:, None] * (mix @ mix.T) * sigma
    state = State(w[0] * 1.02, q[0], K + 0.02, p + 0.05, P, position=r, axes_free=True, moving=moving)
    seen = Measurements(
        np.concatenate([[0.0], np.diff(t)]),
        np.concatenate([extra, z.reshape(n, -1)], axis=1),
        np.concatenate(
            [np.full((n, 3), 1e-4), np.full((n, 3), 1e-6), np.full((n, 1), 1e-2), np.full((n, z[0].size), SIGMA**2)], 1
        ),
        RIG,
        attitude=att,
        rates=True,
        range=True,
        disparity=flow,
        flow=flow,
        spin=np.tile(from_rotation_vector(np.array([1e-3, 2e-3, 0])), (n, 1)) if moving else None,
    )
    return state, seen, Noise(w=1e-8, attitude=1e-9, k=1e-8, velocity=1e-8), Settings(gate=gate, additive=additive)


@pytest.mark.parametrize(
    ("additive", "moving", "flow", "gate"),
    [(False, True, False, 5.0), (True, False, True, 0.0), (False, False, True, 4.0)],
)
def test_numpy_alone_gives_the_same_numbers(additive: bool, moving: bool, flow: bool, gate: float) -> None:
    state, seen, noise, settings = filter_case(additive, moving, flow, gate)
    a = filter_epochs(state, seen, noise, settings, loop=run_loop)
    b = filter_epochs(state, seen, noise, settings)
    for name in ("w", "q", "k", "axes", "position", "velocity", "sigma", "block"):
        assert np.abs(getattr(a, name) - getattr(b, name)).max() < 1e-8, name
    assert np.abs(a.last.P - b.last.P).max() < 1e-8
    assert np.array_equal(a.used, b.used) and np.array_equal(a.gated, b.gated)
    assert not gate or a.gated[18] > 0, "the displaced point is rejected"


def test_it_is_the_unscented_filter_of_the_textbook() -> None:
    """One epoch against sigma points written out in full, all of them through motion and sight."""
    state, seen, noise, settings = filter_case(False, False, False, 0.0, n=2, gaps=False)
    got = filter_epochs(state, seen, noise, settings, loop=run_loop)
    first = filter_epochs(state, replace_rows(seen, 1), noise, settings, loop=run_loop).last
    alpha, beta, n = settings.alpha, settings.beta, len(state.P)
    lam = alpha**2 * n - n
    wm = np.full(2 * n + 1, 0.5 / (n + lam))
    wm[0] = lam / (n + lam)
    wc = wm.copy()
    wc[0] += 1 - alpha**2 + beta

    def points(P: np.ndarray) -> np.ndarray:
        L = np.sqrt(n + lam) * np.linalg.cholesky(P)
        return np.concatenate([np.zeros((1, n)), L.T, -L.T])

    def moved(e: np.ndarray, base: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        k = base.k + e[6:8]
        inertia = np.diag([np.exp(k[0]), 1.0, np.exp(-k[1])])
        q, w = multiply(base.q, from_rotation_vector(e[3:6])), base.w + e[:3]
        path = propagate(q, w, inertia, np.array([0.0, seen.dt[1]]), largest_turn=0.01)
        return path[0][1], path[1][1], k

    def turn(q: np.ndarray, p: np.ndarray) -> np.ndarray:
        from massprops.dynamics.quaternion import rotation_vector

        return rotation_vector(multiply(conjugate(q), p))

    E = points(first.P)
    out = [moved(e, first) for e in E]
    D = E.copy()
    for i, (q, w, _) in enumerate(out):
        D[i, :3], D[i, 3:6] = w - out[0][1], turn(out[0][0], q)
    mean = wm @ D
    P = (wc[:, None] * (D - mean)).T @ (D - mean) + np.diag(noise.diagonal(state)) * seen.dt[1]
    q, w = multiply(out[0][0], from_rotation_vector(mean[3:6])), out[0][1] + mean[:3]
    k, p = first.k + mean[6:8], first.features + mean[11:].reshape(-1, 3)
    axes = multiply(first.axes, from_rotation_vector(mean[8:11]))

    def sight(e: np.ndarray) -> np.ndarray:
        qi, wi = multiply(q, from_rotation_vector(e[3:6])), w + e[:3]
        s = multiply(axes, from_rotation_vector(e[8:11]))
        X = first.position + rotate(qi, p + e[11:].reshape(-1, 3))
        uv = [800 * (X - c.t)[:, :2] / X[:, 2:] + [320, 240] for c in RIG]
        attitude = turn(multiply(q, axes), multiply(qi, s))
        range_m = [np.linalg.norm(first.position)]
        return np.concatenate([attitude, rotate(conjugate(s), wi), range_m, np.concatenate(uv, axis=1).ravel()])

    E = points(P)
    H = np.array([sight(e) for e in E])
    h = wm @ H
    S = (wc[:, None] * (H - h)).T @ (H - h) + np.diag(seen.variance[1])
    C = (wc[:, None] * E).T @ (H - h)
    gain = C @ np.linalg.inv(S)
    z = seen.z[1].copy()
    assert seen.attitude is not None
    z[:3] = turn(multiply(q, axes), seen.attitude[1])
    assert np.allclose(got.w[1], w + (gain @ (z - h))[:3], atol=1e-8)
    assert np.allclose(got.k[1], k + (gain @ (z - h))[6:8], atol=1e-7)
    assert np.allclose(got.last.P, P - gain @ S @ gain.T, atol=1e-8)
    assert got.nis[1] == pytest.approx((z - h) @ np.linalg.inv(S) @ (z - h), rel=1e-5)


@pytest.mark.parametrize("rounds", [1, 6])
def test_a_linearised_update_is_that_of_the_textbook(rounds: int) -> None:
    """One epoch: linearised once it is Kalman's gain; iterated it ends at the most probable state, as Gauss-Newton does."""
    state, seen, noise, _ = filter_case(False, True, False, 0.0, n=1, gaps=False)
    got = filter_epochs(state, seen, noise, Settings(alpha=0.01, gate=0.0, rounds=rounds)).last
    assert seen.attitude is not None
    z, R = seen.z[0].copy(), seen.variance[0]
    mid = multiply(state.q, state.axes)
    z[:3] = rotation_vector(multiply(conjugate(mid), seen.attitude[0]))

    def sight(e: np.ndarray) -> np.ndarray:
        q, w = multiply(state.q, from_rotation_vector(e[3:6])), state.w + e[:3]
        s = multiply(state.axes, from_rotation_vector(e[8:11]))
        r = state.position + e[11:14]
        X = r + rotate(q, state.features + e[17:].reshape(-1, 3))
        uv = [800 * (X - c.t)[:, :2] / X[:, 2:] + [320, 240] for c in RIG]
        attitude = rotation_vector(multiply(conjugate(mid), multiply(q, s)))
        return np.concatenate(
            [attitude, rotate(conjugate(s), w), [np.linalg.norm(r)], np.concatenate(uv, axis=1).ravel()]
        )

    e, n = np.zeros(len(state.P)), len(state.P)
    for _ in range(rounds):
        H = np.stack([(sight(e + d) - sight(e - d)) / 2e-6 for d in 1e-6 * np.eye(n)], axis=1)
        K = state.P @ H.T @ np.linalg.inv(H @ state.P @ H.T + np.diag(R))
        e = K @ (z - sight(e) + H @ e)
    sigma = np.sqrt(np.diag(state.P - K @ H @ state.P))
    found = np.concatenate(
        [
            got.w - state.w,
            rotation_vector(multiply(conjugate(state.q), got.q)),
            got.k - state.k,
            rotation_vector(multiply(conjugate(state.axes), got.axes)),
            got.position - state.position,
            got.velocity - state.velocity,
            (got.features - state.features).ravel(),
        ]
    )
    assert np.abs((found - e) / sigma).max() < (1e-3 if rounds == 1 else 0.1)
    assert np.allclose(np.sqrt(np.diag(got.P)), sigma, rtol=1e-4 if rounds == 1 else 0.05)


def replace_rows(seen: Measurements, n: int) -> Measurements:
    names = ("dt", "z", "variance", "attitude")
    return replace(seen, **{name: getattr(seen, name)[:n] for name in names})


def test_the_compiled_loop_is_one_piece_of_machine_code() -> None:
    """Else what runs after compiling is not what the cache holds, and a second run differs in its last digits."""
    from numba.core.caching import NullCache
    from numba.core.dispatcher import Dispatcher

    loop = compiled("run_loop", *KERNEL, one_piece=True)
    pieces = {f for f in loop.py_func.__globals__.values() if isinstance(f, Dispatcher)}
    assert len(pieces) > 20
    assert {f for f in pieces if not isinstance(f._cache, NullCache)} == {loop}
    assert all(f.targetoptions.get("forceinline") for f in pieces - {loop})


def test_stereo_tracks_give_ratios_within_their_sigmas() -> None:
    found = run(stereo())
    assert found.converged and found.observable
    error = np.array([found.k1, found.k2]) - K
    assert np.all(np.abs(error) < 0.01)
    assert np.all(np.abs(error) < 4 * found.sigma_k)
    assert 0.8 < found.innovation < 1.2
    assert found.position is not None and np.allclose(found.velocity[-1], 0.004 * np.array([1, 0.5, -0.7]), atol=1e-3)


def test_features_come_and_go() -> None:
    given = stereo(m=12)
    uv = given.uv.copy()
    for i in range(12):
        hidden = np.full(len(uv), i >= 4)
        hidden[20 * i : 20 * i + 80] = False
        uv[hidden, :, i] = np.nan
    found = run(replace(given, uv=uv))
    assert found.converged and found.observable
    assert np.all(np.abs(np.array([found.k1, found.k2]) - K) < 0.02)
    assert found.feature_ids is not None and len(found.feature_ids) > 8, "late features were taken up"


def test_a_new_feature_keeps_what_it_shares_with_the_pose() -> None:
    state, *_ = filter_case(False, True, False, 0.0)
    X = state.position + rotate(state.q, np.array([[0.4, -0.3, 0.2]]))
    more = with_features(state, X, 1e-4 * np.eye(3)[None])
    assert np.allclose(more.features[-1], [0.4, -0.3, 0.2])
    e = np.zeros(len(state.P))
    e[3:6], e[11:14] = [1e-5, -2e-5, 3e-5], [1e-5, 0, -1e-5]
    q, r = multiply(state.q, from_rotation_vector(e[3:6])), state.position + e[11:14]
    moved = rotate(conjugate(q), X[0] - r) - more.features[-1]
    cross = more.P[-3:, : len(e)] @ np.linalg.solve(state.P, e)
    assert np.allclose(cross, moved, atol=1e-9)
    assert np.allclose(without_features(more, np.arange(5) < 4).P, state.P)


def test_attitudes_alone_with_outliers() -> None:
    t, q, _ = motion(240)
    rng = np.random.default_rng(1)
    off = from_rotation_vector(np.array([0.4, -0.3, 0.8]))
    measured = multiply(multiply(q, conjugate(off)), from_rotation_vector(2e-3 * rng.normal(size=(240, 3))))
    measured[100] = multiply(measured[100], from_rotation_vector(np.array([0.5, 0, 0])))
    given = problem(t, np.zeros((240, 2, 0, 2)), attitude=measured, sigma_attitude=np.full(240, 2e-3))
    found = run(given)
    assert found.converged and found.observable and found.body_frame == "attitude0"
    error = np.array([found.k1, found.k2]) - K
    assert np.all(np.abs(error) < np.minimum(4 * found.sigma_k, 0.01))
    axes = rotate(off, np.eye(3)).T
    assert np.allclose(np.abs(np.sum(axes * found.principal_axes, axis=0)), 1.0, atol=1e-4)
    assert found.gated >= 3
    assert angle_between(found.q[-1], multiply(q[-1], conjugate(off))) < 3e-3


def test_rates_alone() -> None:
    t, _, w = motion(300)
    rates = w + 1e-4 * np.random.default_rng(2).normal(size=w.shape)
    found = run(problem(t, np.zeros((300, 2, 0, 2)), rates=rates, sigma_rate=np.array(1e-4)))
    assert found.converged and found.observable
    assert np.all(np.abs(np.array([found.k1, found.k2]) - K) < np.minimum(4 * found.sigma_k, 0.01))


@pytest.mark.parametrize("axis", [0, 2])
def test_a_flat_spin_shows_nothing(axis: int) -> None:
    t, q, _ = motion(200, w0=0.3 * np.eye(3)[axis])
    measured = multiply(q, from_rotation_vector(2e-3 * np.random.default_rng(4).normal(size=(200, 3))))
    found = run(problem(t, np.zeros((200, 2, 0, 2)), attitude=measured, sigma_attitude=np.full(200, 2e-3)))
    assert not (found.converged and found.observable)
    assert found.reason
    if not found.observable:
        assert found.k1 is None and found.k2 is None


@pytest.mark.parametrize("loop", [None, run_loop], ids=["compiled", "numpy"])
def test_never_not_finite(loop: Loop | None) -> None:
    """A start that is wrong in everything, then nothing to see for a long time with much process noise."""
    state, seen, _, settings = filter_case(False, True, True, 0.0, n=60)
    z = seen.z.copy()
    z[20:] = np.nan
    wild = replace(state, w=np.array([40.0, -30, 20]), k=np.array([3.0, -4.0]), P=state.P * 1e4)
    noise = Noise(w=1.0, attitude=1.0, k=1.0, position=1.0, velocity=1.0, features=1.0)
    result = filter_epochs(wild, replace(seen, z=z), noise, settings, loop=loop)
    for name in ("w", "q", "k", "position", "sigma", "nis"):
        assert np.isfinite(getattr(result, name)).all(), name


def test_a_body_that_turns_a_radian_a_frame() -> None:
    w0 = 2 * np.pi * 0.175 * np.array([2.0, 1.0, 2.0]) / 3
    t, q, _ = motion(60, 1.0, w0)
    measured = multiply(q, from_rotation_vector(1e-3 * np.random.default_rng(5).normal(size=(60, 3))))
    given = problem(t, np.zeros((60, 2, 0, 2)), attitude=measured, sigma_attitude=np.full(60, 1e-3))
    found = run(given)
    assert found.converged and found.observable
    assert np.all(np.abs(np.array([found.k1, found.k2]) - K) < 0.01)


@pytest.mark.bench
def test_speed() -> None:
    from massprops.campaigns.papers._kabir2025_speed import _filter_speed

    found = _filter_speed()
    print(found)
    assert found["states"] == 24 and found["measurements"] == 45
    assert found["ukf_us_per_step"] <= 60.0
