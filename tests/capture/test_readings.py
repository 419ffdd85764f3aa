"""What the user points at, and the readings between which points alone do not decide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from test_object_on_support import box, rectangle, scene

from massprops.capture.choice import Located, Pointed, check_early, locate, parse
from massprops.capture.readings import KEEP_SUPPORT, Found, described, find_object, picture
from massprops.capture.scene import Scene
from massprops.capture.stand import FACING, _is_round, _slopes
from massprops.dense.region import Region
from massprops.errors import InputError, NotPossible
from massprops.run.stage_images import turns
from massprops.run.stages import shape
from massprops.run.stages.mass import readings_of
from massprops.surface.cloud import Cloud
from massprops.views import Views

SIZE = (320, 240)
K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
GREY, RED, BLUE = (120, 120, 120), (200, 40, 40), (40, 60, 200)
PIXEL = 0.006


def orbit(n: int = 24) -> Views:
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    centre = np.column_stack([2 * np.cos(turn), 2 * np.sin(turn), np.full(n, 1.5)])
    z = np.array([0, 0, 0.1]) - centre
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R = np.stack([x, np.cross(z, x), z], axis=1)
    many = {
        "K": np.tile(K, (n, 1, 1)),
        "distortion": np.zeros((n, 4)),
        "R": R,
        "t": -np.einsum("nij,nj->ni", R, centre),
    }
    names = tuple(f"cam0/{i:02d}.jpg" for i in range(n))
    return Views(names=names, timestamp_ns=np.full(n, -1), size=np.tile(SIZE, (n, 1)), **many)


VIEWS = orbit()


def made(*parts: tuple[tuple[np.ndarray, np.ndarray], tuple[int, int, int]]) -> Scene:
    xyz, normal = scene(*(p for p, _ in parts))
    rgb = np.concatenate([np.tile(np.array(c, np.uint8), (len(p[0]), 1)) for p, c in parts])
    return Scene(xyz, normal, rgb, VIEWS, Region(np.array([0, 0, 0.1]), 1.0), PIXEL)


def ground(rng: np.random.Generator, half: float = 0.2, z: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    xyz, normal = rectangle(rng, 40_000, 1.0, 1.0, z)
    free = (np.abs(xyz[:, :2]) > half).any(1)
    return xyz[free], normal[free]


def pixel_of(point: tuple[float, float, float], view: int = 0, name: str = "object") -> Located:
    camera = VIEWS.R[view] @ np.array(point) + VIEWS.t[view]
    uv = (K @ (camera / camera[2]))[:2]
    return Located(Pointed(f"--{name} {uv[0]:.0f},{uv[1]:.0f}", "", tuple(uv)), view, "00.jpg", uv[None])


def two_boxes() -> tuple[Scene, int, int]:
    """A red and a blue box of like size, each as far from the middle; the numbers of their points."""
    rng = np.random.default_rng(0)
    left = box(rng, 6000, np.array([0.1, 0.1, 0.12]), np.array([-0.2, 0, 0.12]))
    right = box(rng, 6000, np.array([0.1, 0.12, 0.1]), np.array([0.21, 0, 0.1]))
    table = rectangle(rng, 40_000, 1.0, 1.0, 0.0)
    return made((table, GREY), (left, RED), (right, BLUE)), 6000, 6000


def on_stand(colour: tuple[int, int, int] = RED, half: float = 0.25, high: float = 0.08) -> Scene:
    """A box of some colour, 0.2 wide, on a blue block of some half width and height on a table; 0.32 high together."""
    rng = np.random.default_rng(1)
    block = box(rng, 16_000, np.array([half, half, 0.5 * high]), np.array([0, 0, 0.5 * high]))
    carried = (block[0][:, 2] > high - 0.005) & (np.abs(block[0][:, :2]) < 0.1).all(1)
    block = block[0][~carried], block[1][~carried]
    own = box(rng, 8000, np.array([0.1, 0.1, 0.5 * (0.32 - high)]), np.array([0, 0, 0.5 * (0.32 + high)]))
    return made((ground(rng, half), GREY), (block, BLUE), (own, colour))


def share(found: Found, points: Scene, colour: tuple[int, int, int]) -> float:
    return float(found.split.member[(points.rgb == colour).all(1)].mean())


# ---- pointing


@pytest.mark.parametrize(("x", "own", "other"), [(-0.2, RED, BLUE), (0.21, BLUE, RED)])
def test_the_piece_under_the_pixel_is_the_object(x: float, own: tuple, other: tuple) -> None:
    points, *_ = two_boxes()
    for view in (0, 7, 15):
        found = find_object(points, [pixel_of((x, 0, 0.22), view)])
        assert share(found, points, own) > 0.85 and share(found, points, other) == 0 and not found.readings
        assert found.split.other[(points.rgb == other).all(1)].mean() > 0.85, "the other's lines of sight carve"


def test_a_pixel_on_a_side_without_points(x: float = -0.2) -> None:
    """A glossy side shows no points of its own, and those of the table behind it lie under the pixel."""
    points, *_ = two_boxes()
    # view 6 looks along -y: the side towards it and the far one, seen through it, are bare
    red, (px, py, pz) = (points.rgb == RED).all(1), points.xyz.T
    sides = red & (np.abs(py) > 0.05) & (np.abs(px - x) < 0.06) & (pz < 0.2)
    below = (np.abs(px - x) < 0.1) & (np.abs(py) < 0.1) & (pz < 0.01)
    keep = np.flatnonzero(~sides & ~below)
    bare = replace(points, xyz=points.xyz[keep], normal=points.normal[keep], rgb=points.rgb[keep])
    found = find_object(bare, [pixel_of((x, 0.1, 0.12), 6)])
    assert share(found, bare, RED) > 0.8 and share(found, bare, BLUE) == 0


def test_several_pixels_are_several_parts() -> None:
    points, *_ = two_boxes()
    found = find_object(points, [pixel_of((-0.2, 0, 0.24)), pixel_of((0.21, 0, 0.2))])
    assert min(share(found, points, c) for c in (RED, BLUE)) > 0.85


@pytest.mark.parametrize("at", [(0.0, -0.7, 0.0), (0.55, 0.55, 0.0)])
def test_a_pixel_on_the_table_is_refused(at: tuple[float, float, float]) -> None:
    points, *_ = two_boxes()
    with pytest.raises(NotPossible, match=r"--object .*00\.jpg shows the background.*--box"):
        find_object(points, [pixel_of(at, 3)])


def test_a_rectangle_holds_the_object() -> None:
    points, *_ = two_boxes()
    corners = np.array([[x, y, z] for x in (-0.32, -0.08) for y in (-0.12, 0.12) for z in (0, 0.26)])
    uv = np.concatenate([pixel_of(tuple(c), 6).uv for c in corners])
    at = Located(Pointed("--box", "", (0.0,) * 4), 6, "06.jpg", np.stack([uv.min(0), uv.max(0)]))
    found = find_object(points, [at])
    assert share(found, points, RED) > 0.85 and share(found, points, BLUE) == 0
    empty = replace(at, uv=np.array([[2.0, 2.0], [30.0, 20.0]]))
    with pytest.raises(NotPossible, match="nothing that rises"):
        find_object(points, [empty])


# ---- two readings


def test_two_things_of_like_size_are_both_named() -> None:
    points, *_ = two_boxes()
    found = find_object(points)
    assert len(found.readings) == 2 and all("--object" in r.option for r in found.readings)
    both = [described(r, points, used=k == 0) for k, r in enumerate(found.readings)]
    assert [b["used"] for b in both] == [True, False]
    assert np.allclose([sorted(b["extent"]) for b in both], [[0.2, 0.2, 0.24]] * 2, atol=0.06)
    assert not (found.readings[0].member & found.readings[1].member).any()
    assert np.array_equal(found.readings[0].member, found.split.member)


def test_a_small_or_distant_neighbour_is_no_second_reading() -> None:
    rng = np.random.default_rng(3)
    own = box(rng, 6000, np.array([0.15, 0.1, 0.12]), np.array([0, 0, 0.12]))
    small = box(rng, 600, np.array([0.03, 0.03, 0.03]), np.array([0.3, 0, 0.03]))
    distant = box(rng, 5000, np.array([0.12, 0.12, 0.12]), np.array([-0.7, 0.3, 0.12]))
    assert find_object(made((ground(rng), GREY), (own, RED), (small, BLUE), (distant, BLUE))).readings == []


def test_one_thing_whose_middle_could_not_be_measured_is_one() -> None:
    rng = np.random.default_rng(4)
    own = box(rng, 9000, np.array([0.3, 0.1, 0.12]), np.array([0, 0, 0.12]))
    seen = np.abs(own[0][:, 0]) > 0.12
    table, normal = rectangle(rng, 40_000, 1.0, 1.0, 0.0)
    free = (np.abs(table) > [0.3, 0.1, -1]).any(1) & ~((np.abs(table[:, 0]) < 0.3) & (np.abs(table[:, 1]) < 0.1))
    points = made(((table[free], normal[free]), GREY), ((own[0][seen], own[1][seen]), RED))
    assert find_object(points).readings == []


def test_what_it_stands_on_is_not_silently_the_object() -> None:
    points = on_stand()
    found = find_object(points)
    assert share(found, points, RED) > 0.85 and share(found, points, BLUE) < 0.02
    assert found.split.plane is not None and abs(found.split.plane[3] + 0.08) < 0.01, "closed at the stand's top"
    assert len(found.readings) == 2 and found.readings[1].option == "--keep-support"
    assert found.readings[1].member[(points.rgb == BLUE).all(1)].mean() > 0.7


@pytest.mark.parametrize("keep", [True, False])
def test_the_user_settles_it(keep: bool) -> None:
    points = on_stand()
    settled = find_object(points, keep_support=True) if keep else find_object(points, [pixel_of((0.0, 0.0, 0.32))])
    assert settled.readings == [] and share(settled, points, RED) > 0.85
    assert (share(settled, points, BLUE) > 0.7) == keep
    at_stand = find_object(points, [pixel_of((0.2, 0.2, 0.08))])
    assert share(at_stand, points, BLUE) > 0.7, "who points at the stand means it too"


def test_a_plate_with_a_handle_of_its_own_colour_is_one_thing_and_the_handle_is_named() -> None:
    points = on_stand(BLUE)
    found = find_object(points)
    blue = (points.rgb == BLUE).all(1)
    assert found.split.member[blue].mean() > 0.7 and np.array_equal(found.readings[0].member, found.split.member)
    assert len(found.readings) == 2 and found.readings[1].member[points.xyz[:, 2] < 0.07].mean() < 0.01


def test_a_narrow_ledge_of_its_own_colour_is_a_moulding_and_of_another_colour_a_stand() -> None:
    points = on_stand(BLUE, half=0.12)
    sole = find_object(points)
    assert sole.narrow_ledge and sole.readings == [] and share(sole, points, BLUE) > 0.7
    stand = find_object(on_stand(RED, half=0.12))
    assert not stand.narrow_ledge and len(stand.readings) == 2
    assert not find_object(on_stand(BLUE)).narrow_ledge
    rim = on_stand(BLUE, half=0.12, high=0.24)
    near_the_top = find_object(rim)
    assert not near_the_top.narrow_ledge and near_the_top.readings == [] and share(near_the_top, rim, BLUE) > 0.7


@pytest.mark.parametrize("colour", [RED, BLUE])
def test_what_is_far_above_what_the_cameras_look_at_stands_on_no_stand(colour: tuple[int, int, int]) -> None:
    """As of the relief of a jug's lid."""
    points = replace(on_stand(colour, half=0.25, high=0.25), region=Region(np.array([0, 0, 0.08]), 1.0))
    found = find_object(points)
    assert found.readings == [] and share(found, points, colour) > 0.7 and share(found, points, BLUE) > 0.7
    for height in (0.27, 0.17):
        # what is flat and wide may be looked at a little too low
        assert len(find_object(replace(points, region=Region(np.array([0, 0, height]), 1.0))).readings) == 2


def test_a_plate_that_was_turned_over_with_its_handle_is_one_thing() -> None:
    points = on_stand(BLUE)
    found = [described(r, points, used=k == 0) for k, r in enumerate(find_object(points).readings)]
    shape_json = {"placements": [{"readings": found}, {"readings": []}]}
    assert len(readings_of(shape_json, 1.0)) == 2 and readings_of(shape_json, 1.0, moved=True) == []
    stand = [described(r, points, used=k == 0) for k, r in enumerate(find_object(on_stand()).readings)]
    assert len(readings_of({"placements": [{"readings": stand}]}, 1.0, moved=True)) == 2


@pytest.mark.parametrize(("at", "whole"), [((0.0, 0.0, 0.32), False), ((0.2, 0.2, 0.08), True)])
def test_a_pixel_above_or_below_the_ledge_settles_it(at: tuple[float, float, float], whole: bool) -> None:
    points = on_stand(BLUE)
    found = find_object(points, [pixel_of(at)])
    assert found.readings == [] and (found.split.member[points.xyz[:, 2] < 0.07].mean() > 0.1) == whole


@pytest.mark.parametrize(("hue", "apart"), [((158, 150, 136), True), ((160, 156, 159), False)])
def test_hues_tell_a_pale_thing_from_a_pale_stand(hue: tuple[int, int, int], apart: bool) -> None:
    """In light and shade their colours overlap by far more than the limit."""
    points = on_stand(hue)
    rng = np.random.default_rng(6)
    pale = np.where((points.rgb == BLUE).all(1)[:, None], (160, 156, 159), points.rgb)
    shaded = np.clip(pale * rng.uniform(0.5, 1.0, (len(pale), 1)) + rng.normal(0, 1.5, pale.shape), 0, 255)
    found = find_object(replace(points, rgb=shaded.astype(np.uint8)))
    assert len(found.readings) == 2
    stand = found.split.member[(points.rgb == BLUE).all(1)].mean()
    assert stand < 0.02 if apart else stand > 0.7


def on_plate(colour: tuple[int, int, int] = RED) -> Scene:
    """A box of some colour on a blue plate that turns: nothing is measured of the room, and the plate's rim is seen."""
    points = on_stand(colour)
    seen = np.flatnonzero(((points.rgb == BLUE) | (points.rgb == RED)).all(1) & (points.normal[:, 2] > -0.5))
    return replace(points, xyz=points.xyz[seen], normal=points.normal[seen], rgb=points.rgb[seen])


def test_a_plate_that_turns_carries_what_is_on_it_though_its_rim_lies_below() -> None:
    """As a glossy figure on a printed turntable, measured with the plate and twice as large."""
    points = on_plate()
    whole = find_object(points)
    assert whole.split.plane is None and whole.split.member.mean() > 0.9, "the rim lies below: this is no support"
    found = find_object(points, turning=True)
    assert share(found, points, RED) > 0.85 and share(found, points, BLUE) < 0.02
    assert found.readings == [] and found.split.plane is not None and abs(found.split.plane[3] + 0.08) < 0.01
    assert find_object(points, keep_support=True, turning=True).split.plane is None
    boss = find_object(on_plate(BLUE), turning=True)
    assert boss.split.plane is None and boss.split.member.mean() > 0.9, "a flange with its boss is one thing"
    assert len(boss.readings) == 2 and boss.readings[1].member.sum() < 0.6 * boss.readings[0].member.sum()


def test_what_turns_with_its_plate_is_not_a_body_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage asks for it where a still camera sees things turn, and only there."""
    points = on_plate()
    none = np.zeros(len(points.xyz) + 1, int)
    cloud = Cloud(points.xyz, points.normal, np.full(len(points.xyz), 0.003), none, np.zeros(0, int))
    monkeypatch.setattr(shape, "_dense", lambda *_: (cloud, points.rgb))
    job: Any = SimpleNamespace(seed=0)
    rough = [shape._rough_support(job, VIEWS, points.region, job, turning=turning) for turning in (True, False)]
    assert rough[0] is not None and rough[1] is None
    still = {"background": "still", "motion": "tumbling", "masks_given": False}
    assert turns(still) and not turns(still | {"motion": "static"})
    assert not turns(still | {"background": "black"}) and not turns(still | {"masks_given": True})


def test_a_box_is_no_stand_of_itself() -> None:
    rng = np.random.default_rng(5)
    own = box(rng, 8000, np.array([0.15, 0.1, 0.12]), np.array([0, 0, 0.12]))
    points = made((ground(rng), GREY), (own, RED))
    painted = points.rgb.copy()
    painted[points.xyz[:, 2] > 0.2] = BLUE
    assert find_object(replace(points, rgb=painted)).readings == []


def test_the_mat_is_kept_where_a_lower_plane_was_seen() -> None:
    """The mat, wide and thin, is the support; with --keep-support the table below it is."""
    rng = np.random.default_rng(6)
    own = box(rng, 6000, np.array([0.12, 0.12, 0.12]), np.array([0, 0, 0.2]))
    mat = box(rng, 30_000, np.array([0.7, 0.7, 0.04]), np.array([0, 0, 0.04]))
    floor = rectangle(rng, 60_000, 1.4, 1.4, 0.0)
    outside = (np.abs(floor[0][:, :2]) > 0.7).any(1)
    few = np.flatnonzero(outside)[:2200]
    points = made((mat, BLUE), (own, RED), ((floor[0][few], floor[1][few]), GREY))
    without, kept = find_object(points), find_object(points, keep_support=True)
    assert share(without, points, BLUE) < 0.02 and share(kept, points, BLUE) > 0.6
    assert min(share(f, points, RED) for f in (without, kept)) > 0.8


def test_the_picture_shows_the_reading() -> None:
    points, *_ = two_boxes()
    found = find_object(points)
    image = np.full((SIZE[1], SIZE[0], 3), 100, np.uint8)
    drawn = picture(found.readings[0], points, 6, image, 320)
    x, y = np.rint(pixel_of((-0.2 if share(found, points, RED) > 0.5 else 0.21, 0.05, 0.2), 6).uv[0]).astype(int)
    assert drawn[y, x, 1] > 120 and (drawn[:20] == 100).all()


# ---- the option


@pytest.mark.parametrize(
    ("option", "value", "file", "numbers"),
    [
        ("object", "12,34", "", (12.0, 34.0)),
        ("object", "a:b.jpg:1.5,2", "a:b.jpg", (1.5, 2.0)),
        ("box", "é 1.png:50,60,10,20", "é 1.png", (10.0, 20.0, 50.0, 60.0)),
    ],
)
def test_forms(option: str, value: str, file: str, numbers: tuple) -> None:
    pointed = parse(option, value)
    assert (pointed.file, pointed.numbers) == (file, numbers)


@pytest.mark.parametrize(
    ("option", "value"),
    [("object", "12"), ("object", "a,b"), ("object", "1,2,3"), ("object", "nan,1"), ("box", "1,2"), ("box", "5,5,5,9")],
)
def test_bad_forms(option: str, value: str) -> None:
    with pytest.raises(InputError, match=f"--{option} .*: (give|an empty rectangle)"):
        parse(option, value)


FOOTAGE = {
    "cameras": [{"id": 0, "source_size": [640, 480]}],
    "frames": [
        {"name": "cam0/Photo_1.jpg", "source_name": "Photo 1.jpg", "camera": 0, "turn": 0, "width": 320, "height": 240},
        {"name": "cam0/b.jpg", "source_name": "b.jpg", "camera": 0, "turn": 1, "width": 240, "height": 320},
        {"name": "cam0/lost.jpg", "source_name": "lost.jpg", "camera": 0, "turn": 0, "width": 320, "height": 240},
    ],
}


def views_of(*names: str) -> Views:
    some = VIEWS.take(np.arange(len(names)))
    return replace(some, names=names)


def test_pixels_of_the_users_image_become_pixels_of_the_view() -> None:
    views = views_of("cam0/b.jpg", "cam0/Photo_1.jpg")
    at = locate(parse("object", "639,479"), FOOTAGE, views)
    assert at.view == 1 and np.allclose(at.uv, [[319.25, 239.25]]) and at.name == "Photo 1.jpg"
    at = locate(parse("object", "b.jpg:479,639"), FOOTAGE, views)
    assert at.view == 0, "its size is 480x640 as shown"
    lens = replace(views, distortion=np.tile([-0.2, 0.05, 0, 0], (2, 1)))
    at = locate(parse("object", "100,100"), FOOTAGE, lens)
    camera = np.array([(at.uv[0, 0] - K[0, 2]) / K[0, 0], (at.uv[0, 1] - K[1, 2]) / K[1, 1], 1.0])
    back = cv2.projectPoints(camera[None], np.zeros(3), np.zeros(3), K, lens.distortion[1])[0].ravel()
    assert np.allclose(back, 100.5 / 2 - 0.5, atol=0.01)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("640,3", "outside the image Photo 1.jpg, which is 640x480"),
        ("b.jpg:500,3", "outside the image b.jpg, which is 480x640"),
        ("-1,3", "outside"),
        ("none.jpg:3,3", "no image none.jpg among those that were used; give it in another, such as Photo 1.jpg"),
        ("lost.jpg:3,3", "lost.jpg could not be placed; give it in another"),
    ],
)
def test_what_cannot_be_located_is_said(value: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        locate(parse("object", value), FOOTAGE, views_of("cam0/b.jpg", "cam0/Photo_1.jpg"))


def test_a_file_that_is_not_there_is_refused_before_any_work(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((20, 30), np.uint8))
    check_early(parse("object", "a.png:29,19"), tmp_path)
    wrong: list[tuple[str, Callable[[], None]]] = [
        ("no image b.png", lambda: check_early(parse("object", "b.png:1,1"), tmp_path)),
        ("30x20 pixels", lambda: check_early(parse("object", "a.png:30,1"), tmp_path)),
        ("30x20 pixels", lambda: check_early(parse("box", "a.png:31,1,40,9"), tmp_path)),
    ]
    for says, call in wrong:
        with pytest.raises(InputError, match=says):
            call()


def test_table_points_that_rise_towards_the_foot_are_no_stand() -> None:
    rng = np.random.default_rng(5)
    own = box(rng, 8000, np.array([0.1, 0.1, 0.2]), np.array([0, 0, 0.2]))
    flat, up = rectangle(rng, 20_000, 0.2, 0.2, 0.0)
    out = np.abs(flat[:, :2]).max(1)
    slope = out > 0.1
    xyz = flat[slope] + np.column_stack([np.zeros((slope.sum(), 2)), 0.05 * rng.random(slope.sum()) ** 2])
    found = find_object(made((ground(rng), GREY), ((xyz, up[slope]), GREY), (own, RED)))
    assert not found.readings
    tall = found.split.member[-8000:]
    assert tall.mean() > 0.9


def test_a_side_that_faces_the_cameras_is_not_what_carries_it() -> None:
    """A tilted plate over a table of which little is measured; another placement has shown the table."""
    rng = np.random.default_rng(3)
    turn = np.deg2rad(40)
    tilt = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    face, normal = rectangle(rng, 40_000, 0.5, 0.4, 0.0)
    plate = face @ tilt.T + [0, 0, 0.35], normal @ tilt.T
    bar = box(rng, 3000, np.array([0.12, 0.03, 0.02]), np.array([0, -0.55, 0.02]))
    table = rectangle(rng, 1500, 0.3, 0.1, 0.0)
    table = table[0] + [0, -0.55, 0], table[1]
    points = made((plate, RED), (bar, BLUE), (table, GREY))
    # photographs from the side to which it looks
    points = replace(points, views=VIEWS.take(VIEWS.centres[:, 1] < -1.0))
    alone, told = find_object(points), find_object(points, known=np.array([0, 0, 1.0, 0]))
    assert alone.split.member[:40_000].mean() < 0.01, "the face is taken for the table"
    assert told.split.member[:40_000].mean() > 0.95 and not told.split.member[40_000:].any()
    # a plane with things below it carries nothing
    wrong = find_object(points, known=np.array([0, 0, 1.0, -0.2]))
    np.testing.assert_array_equal(wrong.split.member, alone.split.member)


@pytest.mark.parametrize("other, whole", [(1.1, True), (0.35, False)])
def test_a_stand_is_the_object_where_the_other_placement_is_as_large(
    monkeypatch: pytest.MonkeyPatch, other: float, whole: bool
) -> None:
    """The upper part of a cup was taken for a thing on a stand; a thing on a real stand stays as large when it is turned over."""
    sizes = {0: 0.3, 1: other}
    monkeypatch.setattr(shape, "_size", lambda _, k: sizes[k])

    def placement(*args: Any, known: Any = None, whole: bool = False) -> dict[str, Any]:
        sizes[args[3]] = 1.0 if whole else 0.3
        return {"readings": [] if whole else [{"option": KEEP_SUPPORT}], "whole": whole}

    monkeypatch.setattr(shape, "_placement", placement)
    part: Any = SimpleNamespace(take=lambda _: None, of_views=lambda _: None)
    placements = [
        {"label": 0, **placement(None, None, None, 0)},
        {"label": 1, "readings": [{"option": "--object X,Y"}]},
    ]
    shape._of_one_size(SimpleNamespace(), part, part, np.array([0, 0, 1]), placements)  # type: ignore[arg-type]
    assert placements[0]["whole"] is whole and sizes[0] == (1.0 if whole else 0.3)
    alone = [placements[0] | placement(None, None, None, 0)]
    shape._of_one_size(SimpleNamespace(), part, part, np.array([0, 0, 1]), alone)  # type: ignore[arg-type]
    assert not alone[0]["whole"], "nothing to compare it with"


def test_a_level_that_meets_its_support_is_no_top_of_a_stand() -> None:
    """As of planes through what scatters above a glossy table about an object's foot."""
    x = np.linspace(-1.0, 1.0, 500)
    noise = np.random.default_rng(0).normal(0.0, 0.004, 500)
    for slope, expected in ((0.0, False), (0.01, False), (0.04, True)):
        level = 0.05 + slope * x
        assert _slopes(noise, level + noise, 1.0) is expected


def test_a_few_wrong_matches_make_no_moulding_of_a_stand() -> None:
    """A disc on a square block of its own colour, whose ledge is .6 of the disc's radius wide; some points are off the disc."""
    from types import SimpleNamespace

    from massprops.capture.stand import _is_narrow

    rng = np.random.default_rng(0)
    square = rng.uniform(-1.6, 1.6, (20_000, 2))
    ledge = square[np.hypot(*square.T) > 1.0]
    turn, high = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(0.05, 0.3, 6000)
    wall = np.column_stack([np.cos(turn), np.sin(turn), high])
    stray = np.column_stack([rng.uniform(-1.6, 1.6, (40, 2)), rng.uniform(0.05, 0.3, 40)])
    xyz = np.concatenate([np.column_stack([ledge, 0.002 * rng.standard_normal(len(ledge))]), wall, stray])
    normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    scene: Any = SimpleNamespace(xyz=xyz, normal=normal)
    top = np.array([0.0, 0.0, 1.0, 0.0])
    assert not _is_narrow(scene, np.arange(len(xyz)), xyz[:, 2], 0.04, top)
    moulding = np.concatenate([np.hypot(*ledge.T) < 1.15, np.ones(len(wall) + len(stray), bool)])
    assert _is_narrow(scene, np.flatnonzero(moulding), xyz[moulding, 2], 0.04, top)


def test_round_tops_beside_a_thing_are_no_ledge_of_a_stand() -> None:
    """As of bananas side by side, on which another one lies; a flat top that scatters is a ledge."""
    rng = np.random.default_rng(0)
    square = rng.uniform(-1.6, 1.6, (20_000, 2))
    beside = square[np.hypot(*square.T) > 0.6]
    turn, high = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(0.05, 0.3, 6000)
    wall = np.column_stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), high])
    across = (beside[:, 0] + 0.8) % 1.6 - 0.8
    rounded = 0.8 * (np.sqrt(1 - (across / 0.8) ** 2) - 1)
    upright = np.where(np.abs(across) < 0.8 * np.sin(np.arccos(FACING)), 1.0, 0.0)
    top = np.array([0.0, 0.0, 1.0, 0.0])
    noisy, slice_of_round = (np.cos(np.deg2rad(rng.uniform(0, most, len(beside)))) for most in (10.0, 30.0))
    tops = ((0.0 * rounded, noisy, False), (rounded, upright, True), (0.0 * rounded, slice_of_round, True))
    for low, facing, expected in tops:
        level = np.column_stack([beside, low + 0.005 * rng.standard_normal(len(beside))])
        xyz = np.concatenate([level, wall])
        normal = np.zeros((len(xyz), 3))
        normal[: len(level), 2] = facing
        points: Any = SimpleNamespace(xyz=xyz, normal=normal)
        assert _is_round(points, np.arange(len(xyz)), xyz[:, 2], 0.02, top) is expected
