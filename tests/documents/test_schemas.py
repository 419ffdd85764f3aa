"""The schemas: what they refuse and how they say it, that we write what we read, and that the page of them is current."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprops.documents.body import BodyFile
from massprops.documents.campaign import CampaignFile
from massprops.documents.environment import EnvironmentFile
from massprops.documents.fields import Number, field_of, keys, read, unread
from massprops.documents.filter import FilterFile
from massprops.documents.massprops_json import MassFile
from massprops.documents.model import ModelFile
from massprops.documents.sensor import CameraFile
from massprops.errors import InputError

CAMERA = {"intrinsics": [800, 800, 320, 240]}
ORBIT = {"mu_m3_s2": 3.986e14, "semi_major_axis_m": 7e6, "eccentricity": 0.0, "true_anomaly_rad": 0.0}


@pytest.mark.parametrize(
    ("kind", "content", "says"),
    [
        (CameraFile, {}, "no intrinsics; give intrinsics: [fu, fv, cu, cv]"),
        (CameraFile, {"intrinsics": [1, 2, 3]}, "intrinsics must be 4 finite numbers"),
        (CameraFile, {"intrinsics": [1, 2, 3, math.nan]}, "4 finite numbers"),
        (CameraFile, {"intrinsics": [1, 2, 3, 10**400]}, "4 finite numbers"),
        (CameraFile, {"intrinsics": [1, 2, 3, [4, 5]]}, "4 finite numbers"),
        (CameraFile, {**CAMERA, "sigma_px": 0}, "sigma_px must be above 0 and at most 10000, not 0"),
        (CameraFile, {**CAMERA, "sigma_px": 1e300}, "sigma_px must be above 0 and at most 10000, not 1e+300"),
        (CameraFile, {**CAMERA, "sigma_px": True}, "sigma_px must be a number, not True"),
        (CameraFile, {**CAMERA, "sigma_px": [1]}, "sigma_px must be a number, not [1]"),
        (CameraFile, {**CAMERA, "sigma_px": "0.3\x1b"}, "sigma_px must be a number, not '0.3\\x1b'"),
        (CameraFile, {**CAMERA, "camera_model": "fisheye"}, "camera_model is 'fisheye'; only pinhole is known"),
        (CameraFile, {**CAMERA, "resolution": [0, 480]}, "resolution must be 2 finite numbers from 1"),
        (BodyFile, {"inertai": 3}, "no key 'inertai'; did you mean 'inertia'?"),
        (BodyFile, {"mass_kg": 10**400}, "mass_kg must be a finite number, not an integer of more than 64 bits"),
        (
            EnvironmentFile,
            {"orbit": {**ORBIT, "semi_major_axis_m": 1e-300}},
            "orbit: semi_major_axis_m must be from 1 to",
        ),
        (EnvironmentFile, {"orbit": {**ORBIT, "mu_m3": 1}}, "orbit: no key 'mu_m3'; did you mean 'mu_m3_s2'?"),
        (EnvironmentFile, {"orbit": [1]}, "orbit must be names with values, not [1]"),
        (
            EnvironmentFile,
            {"orbit": {"mu_m3_s2": 1.0}},
            "orbit: no semi_major_axis_m; give semi_major_axis_m: semi-major",
        ),
        (ModelFile, {"format": "massprops-model/1", "effects": [{"name": "x"}]}, "effects: 1: no parameters"),
        (ModelFile, {"format": "massprops-model/1", "effects": 3}, "effects must be a list, not 3"),
        (
            FilterFile,
            {"features": {"ids": [1.5], "xyz": [[0, 0, 0]]}},
            "features: ids must be a list, each of which must be",
        ),
        (CampaignFile, {"kind": "drill", "limits": {"time": 3}}, "limits: no key 'time'; did you mean 'time_s'?"),
    ],
)
def test_one_line_with_place_and_range(kind: Any, content: dict, says: str) -> None:
    with pytest.raises(InputError) as caught:
        read(kind, content, "f.yaml")
    line = str(caught.value)
    assert says in line and line.startswith("f.yaml: ") and "\n" not in line and len(line) < 300, line
    assert line.isprintable()


def test_a_number_that_is_too_large_is_not_called_too_small() -> None:
    for number, value, says in (
        (Number("", above=0), 1e300, "above 0 and at most 1e+60"),
        (Number("", above=0), -1.0, "above 0"),
        (Number("", high=3), -1e300, "at most 3 and at least -1e+60"),
        (Number(""), 1e300, "at most 1e+60"),
    ):
        with pytest.raises(ValueError, match=f"^must be {says.replace('+', '.')}, not "):
            number.check(value)


def test_keys_of_other_programs_are_told_and_misspelt_ones_refused() -> None:
    kept, warnings = unread(CameraFile, {**CAMERA, "gyroscope_noise_density": 1}, "f")
    assert kept == CAMERA and warnings == ["f: gyroscope_noise_density is not read"]
    with pytest.raises(InputError, match="no key 'sigma_pix'; did you mean 'sigma_px'"):
        unread(CameraFile, {**CAMERA, "sigma_pix": 1}, "f")


def test_a_matrix_may_be_flat_nested_or_named() -> None:
    flat = np.arange(16.0).tolist()
    for given in (flat, np.arange(16.0).reshape(4, 4).tolist(), {"rows": 4, "cols": 4, "data": flat}):
        found = read(CameraFile, {**CAMERA, "T_BS": given}, "f").T_BS
        assert found is not None and np.array_equal(found, np.arange(16.0).reshape(4, 4))


def test_every_key_says_what_it_means() -> None:
    for kind in (CameraFile, BodyFile, EnvironmentFile, ModelFile, FilterFile, MassFile, CampaignFile):
        for key in keys(kind):
            assert field_of(kind, key) is not None and field_of(kind, key).about, (kind, key)


def test_the_page_of_files_is_current() -> None:
    docs = Path(__file__).resolve().parents[2] / "docs"
    page = runpy.run_path(str(docs / "generate" / "file_schemas.py"))["page"]
    assert (docs / "files.md").read_text() == page(), "run: python docs/generate/file_schemas.py > docs/files.md"
