"""A film of a body with sides that look alike, placed on the wrong one in part."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
import scene
from scipy.spatial.transform import Rotation
from sfm.test_sound import footage, to_model

from massprops.errors import NotPossible
from massprops.sfm import grown_film
from massprops.sfm.attempt import jumps
from massprops.sfm.contradictions import Contradictions
from massprops.sfm.convert import of_one_moment
from massprops.sfm.footage import FootageRecord
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.predicted_images import predicted
from massprops.sfm.reversed_depth import depth_reversal_resolved
from massprops.views import Views


def filmed(views: Views, moved: int | None = None) -> FootageRecord:
    """The footage of some views, of which those from `moved` on were taken from another place."""
    shown = footage(views)
    frames = (replace(f, place=int(moved is not None and i >= moved)) for i, f in enumerate(shown.frames))
    return replace(shown, frames=tuple(frames))


def tilted(views: Views, first: int) -> Views:
    """Views of which those from the first on were taken by a camera that was tilted."""
    tilt, R, t = Rotation.from_euler("x", 40, degrees=True).as_matrix(), views.R.copy(), views.t.copy()
    R[first:], t[first:] = tilt @ R[first:], t[first:] @ tilt.T
    return replace(views, R=R, t=t)


def test_a_camera_that_was_moved_is_no_jump_of_the_body() -> None:
    views, points = scene.make(20, 60, step_deg=8.0)
    assert not jumps(to_model(views, points), filmed(views))
    moved = tilted(views, 10)
    assert jumps(to_model(moved, points), filmed(moved))
    assert not jumps(to_model(moved, points), filmed(moved, 10))
    folded = moved.R.copy()
    folded[:5] = folded[:5] @ Rotation.from_euler("y", 90, degrees=True).as_matrix()
    assert jumps(to_model(replace(moved, R=folded), points), filmed(moved, 10))


def test_no_rate_of_turning_is_taken_across_two_places_of_a_camera() -> None:
    views, points = scene.make(20, 51, step_deg=5.0)
    moved = tilted(views, 10)
    order, clock = list(views.names), {n: float(t) for n, t in zip(views.names, views.timestamp_ns, strict=True)}
    placed = moved.take(np.r_[6:12])
    camera = {n: int(i >= 10) for i, n in enumerate(order)}
    found = predicted(placed, points, order, clock, camera)
    assert {order.index(n) for n in found.names} == {2, 3, 4, 5, 12, 13, 14, 15}
    for i, name in enumerate(found.names):
        np.testing.assert_allclose(found.R[i], moved.R[order.index(name)], atol=1e-9)


@pytest.mark.parametrize(("jumping", "share"), [(True, 0.0), (False, 0.2)])
def test_what_only_jumps_or_is_only_contradicted_stays(
    monkeypatch: pytest.MonkeyPatch, jumping: bool, share: float
) -> None:
    monkeypatch.setattr(grown_film, "jumps", lambda *_: jumping)
    monkeypatch.setattr(grown_film, "contradictions", lambda *_: Contradictions(share, ()))
    found = SimpleNamespace(database=Path())
    given: Any = SimpleNamespace(found=found, footage=SimpleNamespace(background="still"))
    model: Any = SimpleNamespace()
    assert grown_film.unfolded(model, given) == (model, found)


@pytest.mark.parametrize("follows", [True, False])
def test_a_folded_film_is_cut_and_followed(monkeypatch: pytest.MonkeyPatch, follows: bool) -> None:
    whole, cut, grown = (SimpleNamespace(num_reg_images=lambda n=n: n) for n in (40, 28, 39))

    def followed(model: Any, given: Any) -> Any:
        assert model is cut and given.found == "with parts"
        if not follows:
            raise NotPossible("they do not hold together")
        return grown

    monkeypatch.setattr(grown_film, "jumps", lambda *_: True)
    monkeypatch.setattr(grown_film, "contradictions", lambda *_: Contradictions(0.09, (("a", "b"),)))
    monkeypatch.setattr(grown_film, "_steady_part", lambda *_: (cut, "with parts"))
    monkeypatch.setattr(grown_film, "_followed", followed)
    monkeypatch.setattr(grown_film, "replace", lambda given, found: SimpleNamespace(**{**vars(given), "found": found}))
    given: Any = SimpleNamespace(found=SimpleNamespace(database=Path()), footage=SimpleNamespace(background="still"))
    model, found = grown_film.unfolded(whole, given)  # type: ignore[arg-type]
    assert model is (grown if follows else cut) and found == "with parts"
    assert grown_film.left_out(0) == [] and "12 images" in grown_film.left_out(12)[0]


@pytest.mark.parametrize(("left", "taken"), [(33, True), (18, False)])
def test_before_a_black_sky_a_jump_alone_cuts_a_film(monkeypatch: pytest.MonkeyPatch, left: int, taken: bool) -> None:
    """Images 12 to 19 of a body in foil hung on by chance, 180 degrees off, and no match contradicted them."""
    whole, cut = (SimpleNamespace(num_reg_images=lambda n=n: n) for n in (42, left))
    monkeypatch.setattr(grown_film, "jumps", lambda *_: True)
    monkeypatch.setattr(grown_film, "contradictions", lambda *_: Contradictions(0.0, ()))
    monkeypatch.setattr(grown_film, "_steady_part", lambda *_: (cut, "with parts"))
    monkeypatch.setattr(grown_film, "_followed", lambda model, given: model)
    monkeypatch.setattr(grown_film, "replace", lambda given, found: given)
    found = SimpleNamespace(database=Path())
    given: Any = SimpleNamespace(found=found, footage=SimpleNamespace(background="black"))
    assert grown_film.unfolded(whole, given) == ((cut, "with parts") if taken else (whole, found))  # type: ignore[comparison-overlap,arg-type]


@pytest.mark.parametrize(
    ("repeats", "background", "dark", "placed", "then", "stray_deg", "gain", "followed"),
    [
        (False, "black", 0, 36, 79, 0.0, 3.0, True),
        (False, "black", 0, 36, 36, 0.0, 3.0, False),
        (False, "black", 0, 36, 36, 0.0, 1.2, True),
        (False, "black", 0, 36, 35, 0.0, 1.2, False),
        (False, "black", 0, 84, 88, 0.03, 1.2, False),
        (False, "black", 0, 84, 84, 0.3, 1.2, True),
        (False, "black", 0, 84, 84, 0.3, 2.5, False),
        (False, "black", 50, 36, 40, 0.03, 1.2, False),
        (False, "black", 0, 6, 40, 1.0, 1.2, False),
        (False, "still", 0, 36, 79, 1.0, 1.2, False),
        (True, "still", 0, 84, 80, 0.0, 1.2, True),
    ],
)
def test_a_film_is_followed_along_its_motion_where_images_are_left_or_stray(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    repeats: bool,
    background: str,
    dark: int,
    placed: int,
    then: int,
    stray_deg: float,
    gain: float,
    followed: bool,
) -> None:
    """Of a body in foil 36 of 88 images were placed, and the motion through these leads to 40 more. Heavily compressed, all images of a bus
    were placed and lay .3 degrees from any free motion. What a motion that is refused has matched is put back."""
    model, more = (SimpleNamespace(num_reg_images=lambda n=n: n) for n in (placed, then))
    motion = SimpleNamespace(gain=gain)
    database = tmp_path / "database.db"
    database.write_text("as placed")

    def follow(*_: Any) -> Any:
        database.write_text("along the motion")
        return more, motion

    monkeypatch.setattr(grown_film, "follow_free_motion", follow)
    views = SimpleNamespace(of_first_camera=None, take=lambda _: None)
    monkeypatch.setattr(grown_film, "to_views", lambda _: (views, []))
    monkeypatch.setattr(grown_film, "strays", lambda *_: np.deg2rad(stray_deg))
    given: Any = SimpleNamespace(
        found=SimpleNamespace(repeats=repeats, database=database),
        images_with_features=list(range(88 - dark)),
        footage=SimpleNamespace(background=background, times={}),
    )
    found: Any = grown_film.along_free_motion(model, given)  # type: ignore[arg-type]
    assert found == ((more, motion) if followed else None)
    assert database.read_text() == ("along the motion" if followed else "as placed")


def test_the_images_of_a_pair_go_together() -> None:
    shown = pycolmap.SyntheticDatasetOptions()
    shown.num_rigs, shown.num_cameras_per_rig, shown.num_frames_per_rig, shown.num_points3D = 1, 2, 5, 80
    model = pycolmap.synthesize_dataset(shown)
    left = [i for i in model.reg_image_ids() if model.image(i).camera_id == min(model.cameras)]
    together = of_one_moment(model, left[:2])
    assert together > set(left[:2]) and len(together) == 4
    assert of_one_moment(model, left) == frozenset(model.reg_image_ids())
    # two cameras tell near from far: the reverse is not asked
    kept = depth_reversal_resolved(model, MappingOptions(masked=True, fixed_intrinsics=True, threads=1))
    before, after = (m.image(left[0]).cam_from_world().matrix() for m in (model, kept))
    assert kept.num_reg_images() == 10 and np.allclose(before, after, atol=1e-3)
