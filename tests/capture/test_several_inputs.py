"""Placements that the user has sorted into folders: nothing is guessed, names and cameras stay right."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from test_cameras_and_names import photograph

from massprops.capture.given import GivenMasks
from massprops.capture.placements import given_placements
from massprops.errors import InputError
from massprops.run.job import Job, ReconstructOptions
from massprops.run.masks import mask_names
from massprops.run.reconstruct import checked_options
from massprops.run.stages import capture
from massprops.sfm.footage import read_footage


def folders(tmp_path: Path, second: int = 4) -> tuple[Path, Path]:
    """Five images of one phone, and four with the same names, one of them held upright."""
    a, b = tmp_path / "up side", tmp_path / "down"
    for i in range(5):
        photograph(a / f"{i}.jpg", film=28, model="Phone", seed=i)
    for i in range(second):
        size, orientation = ((320, 240), 6) if i == 1 else ((320, 240), None)
        photograph(b / f"{i}.jpg", size, orientation, film=28, model="Phone", seed=50 + i)
    return a, b


def staged(tmp_path: Path, *sources: Path, **options: object) -> tuple[Path, dict, Job]:
    out = tmp_path / "out"
    out.mkdir()
    more = tuple(str(s) for s in sources[1:])
    job = Job(run=tmp_path, options=ReconstructOptions(source=str(sources[0]), more=more, **options), out=out)  # type: ignore[arg-type]
    capture.run(job)
    return out, json.loads((out / "footage.json").read_text()), job


def test_each_folder_is_a_placement(tmp_path: Path) -> None:
    a, b = folders(tmp_path)
    out, footage, _ = staged(tmp_path, a, b)
    frames = footage["frames"]
    assert [f["placement"] for f in frames] == [0] * 5 + [1] * 4
    assert len({f["name"] for f in frames}) == 9 and footage["motion"] == "static"
    assert [f["index"] for f in frames] == list(range(9)) and {f["timestamp_ns"] for f in frames} == {-1}
    assert frames[0]["source_name"] == "up side/0.jpg" and frames[5]["source_name"] == "down/0.jpg"
    for frame, file in ((frames[3], a / "3.jpg"), (frames[8], b / "3.jpg")):
        stored = cv2.imread(str(out / "frames" / frame["name"]))
        assert np.abs(stored.astype(int) - cv2.imread(str(file))).mean() < 20, "each name has its own picture"
    assert len(footage["cameras"]) == 1 and footage["cameras"][0]["images"] == 9, "one phone, one camera"
    record = read_footage(out)
    for frame in record.frames:
        image = cv2.imread(str(record.image(frame.name)))
        assert record.size(frame) == image.shape[1::-1]


def test_the_division_is_the_users(tmp_path: Path) -> None:
    _, footage, _ = staged(tmp_path, *folders(tmp_path))
    names = [f["name"] for f in footage["frames"]]
    found = given_placements(footage, names[2:])
    assert found is not None and found.count == 2
    assert found.label.tolist() == [1] * 3 + [0] * 4, "most images first"
    for frame in footage["frames"]:
        del frame["placement"]
    assert given_placements(footage, names) is None


def test_a_device_of_its_own_is_a_camera_of_its_own(tmp_path: Path) -> None:
    a, b = folders(tmp_path)
    for i in range(4):
        photograph(b / f"{i}.jpg", (400, 300), film=50, model="Other", seed=i)
    out, footage, _ = staged(tmp_path, a, b)
    assert [c["id"] for c in footage["cameras"]] == [0, 1]
    assert [f["camera"] for f in footage["frames"]] == [0] * 5 + [1] * 4
    assert read_footage(out).cameras[1].size == (400, 300)


def test_masks_are_found_by_folder(tmp_path: Path) -> None:
    a, b = folders(tmp_path)
    for place in (a, b):
        (tmp_path / "masks" / place.name).mkdir(parents=True)
        for i, file in enumerate(sorted(place.iterdir())):
            mask = np.zeros((240, 320), np.uint8)
            mask[10 * i : 200, 50 if place is a else 150 : 300] = 255
            cv2.imwrite(str(tmp_path / "masks" / place.name / f"{file.name}.png"), mask)
    out, footage, _ = staged(tmp_path, a, b, masks=str(tmp_path / "masks"))
    for frame, left, first in ((footage["frames"][2], 50, 20), (footage["frames"][7], 150, 20)):
        seen = cv2.imread(str(out / "masks" / f"{frame['name']}.png"), 0)
        assert np.flatnonzero(seen.any(0))[0] == left and np.flatnonzero(seen.any(1))[0] == first
    assert mask_names(footage)[0] == "up side/0.jpg.png", "as `massprops masks` would write it"
    names = [(f["name"], f["source_name"]) for f in footage["frames"]]
    assert len(GivenMasks(tmp_path / "masks").check(names)) == 9


def test_videos_are_placements_too(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    wide = cv2.resize(rng.integers(0, 255, (30, 300, 3), dtype=np.uint8), (1600, 160), interpolation=cv2.INTER_NEAREST)
    for name, shift in (("a.mp4", 0), ("b.mp4", 700)):
        with av.open(str(tmp_path / name), "w") as container:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = 208, 160, "yuv420p"
            for i in range(30):
                at = shift + 16 * i
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(wide[:, at : at + 208]), format="bgr24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    _, footage, _ = staged(tmp_path, tmp_path / "a.mp4", tmp_path / "b.mp4", frames=10)
    assert {f["placement"] for f in footage["frames"]} == {0, 1} and len(footage["cameras"]) == 1
    assert footage["frames"][0]["source_name"].startswith("a.mp4/") and footage["kind"] == "images"


def test_what_cannot_be_a_placement_is_refused(tmp_path: Path) -> None:
    a, b = folders(tmp_path)
    with pytest.raises(InputError, match="given twice"):
        staged(tmp_path, a, a)
    with pytest.raises(InputError, match="no such file"):
        checked_options([a, tmp_path / "none"], {})
    with pytest.raises(InputError, match="still object"):
        checked_options([a, b], {"motion": "tumbling"})
    (tmp_path / "seq" / "cam0").mkdir(parents=True)
    for i in range(4):
        photograph(tmp_path / "seq" / "cam0" / f"{i}.jpg", seed=i)
    (tmp_path / "out").rmdir()  # of the attempt before
    with pytest.raises(InputError, match="a sequence folder"):
        staged(tmp_path, a, tmp_path / "seq")
    options = checked_options([a, b], {})
    assert options.more == (str(b.resolve()),) and checked_options(a, {}).more == ()


def test_whole_numbers_and_others_are_the_same_option(tmp_path: Path) -> None:
    """In Python `density=150` is usual, on the command line it is 150.0: both belong to the same run."""
    a, _ = folders(tmp_path)
    whole = checked_options(a, {"density": 150, "distance": ("0,0,0", "1,0,0", 2)})
    assert repr(whole) == repr(checked_options(a, {"density": 150.0, "distance": ("0,0,0", "1,0,0", 2.0)}))
