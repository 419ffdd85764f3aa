"""Sides of a body that share no point are held together by its free motion, where it has one."""

from dataclasses import replace

import numpy as np
import pytest
import test_mapping
from scipy.spatial.transform import Rotation
from test_free_motion import tumbling
from test_joined_pieces import filmed, pieces

from massprops.dynamics.rigid_body import propagate
from massprops.errors import NotPossible
from massprops.sfm import along_motion
from massprops.sfm.along_motion import CONVINCES, follow_free_motion, refine_along, strays
from massprops.sfm.assembled import STAYS, Part, Similarity, assemble
from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.free_adjustment import MOTION, MotionSystem, State, adjust_tumble, fit_line
from massprops.sfm.free_motion import BASIS, MOST_LOG, FreeRotation
from massprops.sfm.grown_film import along_free_motion
from massprops.sfm.points import residuals
from massprops.sfm.reversed_depth import reversed_in_depth


def apart(folder, R):
    """Two stretches that share no point, each where its own matching put it, in one model."""
    given, truth = pieces(folder, R, strange=True)
    first, second = given.found.models
    parts = [Part(m, frozenset(m.reg_image_ids()), STAYS) for m in (first, second)]
    return assemble(parts), given, truth


def test_sides_that_share_no_point_come_to_lie_where_they_are(tmp_path):
    model, given, truth = apart(tmp_path, tumbling())
    assert test_mapping.attitude_error(to_views(model)[0], truth) > 0.3
    model, following = follow_free_motion(model, given)
    refined = refine_along(model, following, given.options.refine, True)
    views, ids = to_views(model)
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 0.004
    assert np.median(np.linalg.norm(residuals(views, to_points(model, ids)), axis=1)) < 0.3
    assert abs(views.K[0, 0, 0] / truth.K[0, 0, 0] - 1) < 4 * refined.precision.focal_relative
    # stated for a reader who takes errors for independent: no smaller than the worst that they are
    assert test_mapping.attitude_error(views, truth) < 3 * refined.precision.attitude.max()


def braked():
    """A body that a torque slows down by a tenth in the first 27 frames."""
    steps = np.arange(54.0)
    when = steps - 0.05 * np.minimum(steps, 27) ** 2 / 27
    w0 = np.deg2rad(7.0) * np.array([0.3, 1.0, -0.25]) / np.linalg.norm([0.3, 1.0, -0.25])
    q, _ = propagate(np.array([0.5, 0.5, -0.1, 0.7]), w0, np.diag([0.4, 0.9, 1.0]), when)
    return Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()


@pytest.mark.parametrize("way", ["turned back", "braked"])
def test_a_body_that_is_not_free_keeps_its_own_poses(tmp_path, way):
    R = tumbling()
    R[18:] = R[18:][::-1]
    model, given, _ = apart(tmp_path, R if way == "turned back" else braked())
    assert follow_free_motion(model, given) is None


def tumble():
    turning = FreeRotation(tumbling()[3], np.array([0.05, 0.1, -0.02]), np.array([0.3, -0.2, 0.1, 0.2, -0.4]), 3.0, 2.0)
    views, points = filmed(list(range(0, 20, 3)), tumbling())
    found = fit_line(turning, np.arange(0, 20, 3.0), views.t, 0.2)
    return found, replace(views, R=found.poses(np.arange(0, 20, 3.0))[0]), points


def test_derivatives_of_poses_are_those_of_differences():
    found, views, points = tumble()
    system = MotionSystem(views, points, np.arange(0, 20, 3.0), 1.0, True)
    J = system.columns(found, found.poses(system.times)[0], system.times)
    for k, e in enumerate(1e-6 * np.eye(MOTION + 9)):
        (R, t), (Q, s) = found.changed(e).poses(system.times), found.changed(-e).poses(system.times)
        turn = Rotation.from_matrix(R @ Q.transpose(0, 2, 1)).as_rotvec() / 2e-6
        np.testing.assert_allclose(J[:-1, k].reshape(-1, 6), np.column_stack([turn, (t - s) / 2e-6]), atol=1e-4)


def test_the_slope_of_the_loss_is_that_of_differences():
    found, views, points = tumble()
    system = MotionSystem(views, points, np.arange(0, 20, 3.0), 1e4, True)
    state = State(found, 0.0, points.xyz)
    at = system.linear(state)
    # what the points add is eliminated with them
    step = np.linspace(-1, 1, MOTION + 10)
    xyz = at.system.points_follow(at.columns @ step, 0 * at.of_points)
    ends = [
        system.cost(State(found.changed(s * step), s * float(step[-1]), points.xyz + s * xyz)) for s in (1e-6, -1e-6)
    ]
    assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(step @ at.columns.T @ at.score, rel=1e-3)


def test_a_step_that_makes_the_body_race_is_not_taken():
    found, views, points = tumble()
    system = MotionSystem(views, points, np.arange(0, 20, 3.0), 1.0, True)
    state = system.settled(State(found, 0.0, points.xyz), 10)  # far from any motion that fits
    assert system.cost(state) <= system.cost(State(found, 0.0, points.xyz))
    assert np.abs(state.tumble.turning.inertia).max() < 2.5


def test_a_motion_that_begins_at_a_bound_is_adjusted_all_the_same():
    """A body that is flatter than a motion may be: every step of the ratios leads out of their bound."""
    times, slim = np.arange(0, 20.0), np.array([0.3, -3.2, 0.1, 0.2, -0.4])
    true = FreeRotation(tumbling()[3], np.array([0.05, 0.1, -0.02]), slim, 0.0, 1.0)
    views, points = filmed(list(range(20)), true.attitudes(times)[0])
    near = replace(true.changed(np.r_[0.03, -0.03, 0.03, np.zeros(8)]), inertia=np.clip(slim, -MOST_LOG, MOST_LOG))
    system = MotionSystem(views, points, times, 1.0, True)
    start = State(fit_line(near, times, views.t, 0.2), 0.0, points.xyz)
    found = system.settled(start, 20)
    assert system.cost(found) < 0.7 * system.cost(start)  # where it stands still, 1
    assert np.abs(found.tumble.turning.inertia).max() <= MOST_LOG


def test_a_motion_is_the_same_before_its_beginning_and_after():
    found = tumble()[0].turning
    later = found.attitudes(np.array([9.0, -5.0, 3.0, 4.0]))[0]
    np.testing.assert_allclose(later[2], found.attitude, atol=1e-12)
    state = (Rotation.from_matrix(found.attitude).as_quat()[[3, 0, 1, 2]], found.rate)
    from massprops.sfm.free_motion import inertia_of_log

    q, _ = propagate(*state, inertia_of_log(found.inertia[None])[0], np.array([0.0, 0.5, 3.0]))
    expected = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(later[[3, 0]], expected[1:], atol=1e-5)


def test_where_own_poses_fit_better_the_motion_is_looked_for_from_these(tmp_path, monkeypatch):
    model, given, truth = apart(tmp_path, tumbling())
    own_poses, seen = along_motion._own_poses, []

    def doubted(*args):
        own, worse = own_poses(*args)
        seen.append(own)
        return own, along_motion.WORSE + 1 if len(seen) == 1 else worse

    monkeypatch.setattr(along_motion, "_own_poses", doubted)
    found, _ = follow_free_motion(model, given)
    assert len(seen) == 2
    assert test_mapping.attitude_error(to_views(found)[0], truth) < 0.004


def test_a_part_that_took_near_for_far_is_placed_by_the_motion_of_the_rest(tmp_path):
    R = tumbling(40)
    given, truth = pieces(tmp_path, R, which=range(28))
    model = given.found.models[0]
    ids = [i for _, i in sorted((model.image(i).name, i) for i in model.reg_image_ids())]
    other = reversed_in_depth(model)
    pose = [m.image(ids[9]).cam_from_world().matrix() for m in (model, other)]
    turn = pose[0][:, :3].T @ pose[1][:, :3]
    to = Similarity(1.0, turn, pose[0][:, :3].T @ (pose[1][:, 3] - pose[0][:, 3]))
    wrong = assemble([Part(other, frozenset(ids[:10]), to), Part(model, frozenset(ids[10:]), STAYS)])
    assert test_mapping.attitude_error(to_views(wrong)[0], truth) > 0.3
    found, _ = follow_free_motion(wrong, given)
    views, _ = to_views(found)
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 0.004


def test_images_far_from_the_placed_ones_are_looked_for_last(tmp_path, monkeypatch):
    """A motion is known about its own images: from sixteen it leads to five on a side, and from these on."""
    given, truth = pieces(tmp_path, tumbling(40), which=range(40))
    model = given.found.models[0]
    ids = [i for _, i in sorted((model.image(i).name, i) for i in model.reg_image_ids())]
    take_out_images(model, set(ids[16:]))
    one, asked = along_motion._round, []

    def seen(model, start, names, *rest):
        asked.append(len(names))
        return one(model, start, names, *rest)

    monkeypatch.setattr(along_motion, "_round", seen)
    found, _ = follow_free_motion(model, given)
    views, _ = to_views(found)
    assert asked == [16, 21, 27, 34, 40, 40, 40]
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 0.004


def test_a_motion_that_no_image_is_left_of_is_refused(tmp_path):
    model = apart(tmp_path, tumbling())[0]
    take_out_images(model, list(model.reg_image_ids()))
    with pytest.raises(NotPossible, match="none is left"):
        adjust_tumble(model, tumble()[0], lambda name: 0.0, 1.0, True)


def test_all_is_matched_anew_until_the_motion_rests(tmp_path, monkeypatch):
    model, given, _ = apart(tmp_path, tumbling())
    moved, gates, one_round = iter([5.0, 0.5]), [], along_motion._round

    def counted(model, start, names, gate, *rest):
        gates.append(gate)
        return one_round(model, start, names, gate, *rest)

    monkeypatch.setattr(along_motion, "_round", counted)
    monkeypatch.setattr(along_motion, "_moved_px", lambda *rest: next(moved))
    assert follow_free_motion(model, given) is not None
    assert gates[-5:] == [*along_motion.GATES[1:], *along_motion.GATES]


def test_a_motion_in_other_axes_of_the_body_moves_nothing(tmp_path):
    given, _ = pieces(tmp_path, tumbling(40), which=range(16))
    found, times = tumble()[0], np.arange(0, 20.0)
    turn = Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix()
    log = np.einsum("k,kij->ij", found.turning.inertia, BASIS)
    turned = replace(
        found.turning,
        attitude=found.turning.attitude @ turn,
        rate=turn.T @ found.turning.rate,
        inertia=np.einsum("kij,ij->k", BASIS, turn.T @ log @ turn),
    )
    model = given.found.models[0]
    other = replace(found, turning=turned, centre=turn.T @ found.centre)
    assert along_motion._moved_px(model, found, other, times) < 1e-6
    faster = replace(found, turning=replace(found.turning, rate=1.05 * found.turning.rate))
    assert along_motion._moved_px(model, found, faster, times) > 2


def test_a_motion_leads_across_images_that_show_nothing(tmp_path):
    model, given, truth = apart(tmp_path, tumbling())
    placed, gap = list(truth.names[:8]), truth.names[8:14]
    ids = {model.image(i).name: i for i in model.reg_image_ids()}
    take_out_images(model, [i for name, i in ids.items() if name not in placed])
    reach = int(along_motion.NEAR * len(placed)) + 1
    assert along_motion._near(model, given) == {*truth.names[: 8 + reach]}
    dark = {name: (given.found.features[name][0][:0], given.found.features[name][1][:0]) for name in gap}
    found = replace(given.found, features=given.found.features | dark)
    assert along_motion._near(model, replace(given, found=found)) == {*placed, *truth.names[14 : 14 + reach]}


def test_a_film_whose_stretches_lie_askew_is_followed_though_all_of_it_is_placed(tmp_path):
    model, given, truth = apart(tmp_path, tumbling())
    given = replace(given, footage=replace(given.footage, background="black"))
    clock = given.footage.times.__getitem__
    assert model.num_reg_images() == len(given.images_with_features)
    assert strays(to_views(model)[0], clock) > np.deg2rad(1)
    followed, following = along_free_motion(model, given)
    assert test_mapping.attitude_error(to_views(followed)[0], truth) < 0.004 and following.gain < CONVINCES
    # what follows its motion is not followed once more
    assert strays(to_views(followed)[0], clock) < 1e-4
    assert along_free_motion(followed, given) is None
