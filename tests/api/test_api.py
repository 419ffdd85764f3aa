"""The functions of the package: found by name, documented, arrays in and arrays out, results that print in a line."""

from __future__ import annotations

import doctest
import importlib
import inspect
import subprocess
import sys
from pathlib import Path
from types import FunctionType, ModuleType

import numpy as np
import pytest
import trimesh

import massprops
from massprops.api import verbs
from massprops.run.job import ReconstructOptions

VERBS = [name for name in massprops.__all__ if isinstance(getattr(massprops, name), FunctionType)]
WANTED = [
    "reconstruct",
    "estimate",
    "crosscheck",
    "diagnose",
    "compare",
    "export",
    "simulate",
    "mass_properties",
    "campaign",
    "reproduce",
]


def test_the_verbs_are_functions_of_the_package_with_help() -> None:
    assert set(WANTED) <= set(VERBS) and set(massprops.__all__) <= set(dir(massprops))
    for name in VERBS:
        function = getattr(massprops, name)
        assert "Args:" in function.__doc__ and "Raises:" in function.__doc__, name
        for parameter in inspect.signature(function).parameters.values():
            assert parameter.annotation is not inspect.Parameter.empty, (name, parameter.name)
            assert f"\n    {parameter.name}: " in inspect.getdoc(function), (name, parameter.name)


def test_no_name_is_a_function_or_a_module_depending_on_what_was_imported() -> None:
    folder = Path(massprops.__file__).parent
    for path in folder.rglob("*.py"):
        if "__pycache__" not in path.parts and path.parent == folder or path.name == "__init__.py":
            name = path.parent.name if path.name == "__init__.py" else path.stem
            if path.parent.parent == folder or path.parent == folder:
                assert name not in massprops.__all__, f"{path} hides the function of its name"
    for inner in ("mass.properties", "diagnosis.search.case", "consistency.crosscheck", "campaigns.run"):
        importlib.import_module(f"massprops.{inner}")
    assert all(isinstance(getattr(massprops, name), FunctionType) for name in VERBS)
    assert isinstance(massprops.mass, ModuleType)


def test_a_run_opens_again(tmp_path: Path) -> None:
    import trimesh

    made = massprops.mass_properties(trimesh.creation.box((1, 2, 3)), tmp_path / "run", density=2.0)
    again = massprops.open_run(str(tmp_path / "run"))
    assert again.volume == made.volume and again.exit_code == 0 and again.reason == "" and again.mesh.is_volume
    assert "volume 6 m^3" in repr(again) and "<table>" in again._repr_html_()
    with pytest.raises(massprops.InputError, match="no run in this folder; give one"):
        massprops.open_run(tmp_path)


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "cv2", "pycolmap", "open3d", "numba", "trimesh", "yaml", "rich", "typer")
    code = f"import sys, massprops; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_options_of_reconstruct_are_those_of_the_run() -> None:
    parameters = inspect.signature(massprops.reconstruct).parameters
    for name, field in ReconstructOptions.__dataclass_fields__.items():
        if name not in ("source", "more"):
            assert name in parameters, name
            assert parameters[name].default == field.default


def test_the_examples_in_the_documentation_hold(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    found = doctest.testmod(verbs, extraglobs={"massprops": massprops}, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > 10 and found.failed == 0


def test_a_mesh_in_memory_needs_no_folder_and_exports_where_it_is_told(tmp_path: Path) -> None:
    body = massprops.mass_properties(trimesh.creation.icosphere(subdivisions=3, radius=0.5), density=10.0)
    assert body.volume == pytest.approx(np.pi / 6, rel=0.02)
    assert np.allclose(body.inertia, np.eye(3) * body.inertia[0, 0], rtol=0.01) and body.interval == {}
    assert body.mesh.is_watertight and "volume" in repr(body) and len(repr(body)) < 300
    assert "<table>" in body._repr_html_()
    assert massprops.export(body, "mjcf", tmp_path / "ball.xml", density=10.0).is_file()
    with pytest.raises(massprops.InputError, match="give out"):
        massprops.export(body, "mjcf")
    with pytest.raises(massprops.InputError, match="trimesh"):
        massprops.mass_properties(3)  # type: ignore[arg-type]


def test_a_run_of_a_mesh_has_the_same_attributes(tmp_path: Path) -> None:
    run = massprops.mass_properties(trimesh.creation.box((1, 2, 3)), tmp_path / "run", scale_sigma=0.01)
    assert run.interval["volume"] == pytest.approx([6 * (1 - 0.04935), 6 * (1 + 0.04935)])
    assert run.interval["principal_moments"].shape == (3, 2)
    assert run.report().is_file() and run.verdict is None
    assert massprops.compare(run, trimesh.creation.box((1, 2, 3))).row("volume")["relative_error"] == pytest.approx(0)
    assert "0x" not in repr(run) and len(repr(run)) < 400


def test_arrays_in_arrays_out_without_a_folder() -> None:
    seen = massprops.simulate("tracks", frames=120, rates=1e-4, attitude=1e-3, seed=5)
    truth, recording = seen.truth, seen.sequence
    again = massprops.sequence_from_arrays(
        recording.attitude.timestamp_ns * 1e-9,
        attitude=recording.attitude.q,
        attitude_sigma=1e-3,
        rates=recording.rates.w,
        rate_sigma=1e-4,
    )
    found = massprops.estimate(again, method=["momentum-ls"])
    assert found.verdict == "observable" and len(found) == 1 and found["momentum-ls"] is found[0] is found.best
    for name in ("k1", "k2"):
        assert abs(getattr(found, name) - truth.facts[name]) < 0.02
        low, high = found.interval[name]
        assert low < getattr(found, name) < high
    assert len(repr(found)) < 300 and found.report().is_file()


def test_tracks_as_arrays_are_the_tracks_of_the_sequence(tmp_path: Path) -> None:
    seen = massprops.simulate("tracks", frames=30, seed=2).sequence
    stamp = np.unique(seen.tracks.timestamp_ns)
    uv = np.full((2, len(stamp), seen.tracks.feature.max() + 1, 2), np.nan)
    uv[seen.tracks.camera, np.searchsorted(stamp, seen.tracks.timestamp_ns), seen.tracks.feature] = seen.tracks.uv
    fu, fv, cu, cv = seen.cameras[0].intrinsics
    made = massprops.sequence_from_arrays(
        stamp * 1e-9,
        tracks=uv,
        camera_matrix=np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]),
        size=seen.cameras[0].resolution,
        baseline=seen.cameras[1].T_BS[0, 3],
        out=tmp_path / "seq",
    )
    from massprops.sequence import read_sequence

    for one in (made, read_sequence(tmp_path / "seq")):
        assert len(one.tracks.uv) == len(seen.tracks.uv)
        assert np.allclose(np.sort(one.tracks.uv[:, 0]), np.sort(seen.tracks.uv[:, 0]), atol=1e-5)
        assert one.cameras[1].T_BS[0, 3] == seen.cameras[1].T_BS[0, 3]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({}, "nothing measured"),
        ({"rates": np.zeros((4, 3))}, "rates of shape"),
        ({"attitude": np.ones((5, 4))}, "length 1"),
        ({"tracks": np.zeros((5, 3, 2))}, "camera_matrix"),
        ({"tracks": np.zeros((4, 3, 2))}, "tracks of shape"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments: dict[str, np.ndarray], says: str) -> None:
    with pytest.raises(massprops.InputError, match=says):
        massprops.sequence_from_arrays(np.arange(5.0), **arguments)  # type: ignore[arg-type]


def test_frames_in_memory_are_read_as_they_are(tmp_path: Path) -> None:
    from massprops.api.sources import footage
    from massprops.capture.video import read_video

    frames = np.random.default_rng(1).integers(0, 256, (5, 48, 64, 3), dtype=np.uint8)
    with footage(frames, 10.0) as file:
        read = list(read_video(file))
    assert [f.timestamp_ns for f in read] == [0, 100_000_000, 200_000_000, 300_000_000, 400_000_000]
    assert all((f.image[..., ::-1] == frame).all() for f, frame in zip(read, frames, strict=True))
    with pytest.raises(massprops.InputError, match="uint8"), footage(frames.astype(float), 10.0):
        pass


def test_a_simulation_keeps_its_folder_only_as_long_as_it_lives() -> None:
    seen = massprops.simulate("tracks", frames=20)
    folder = seen.folder
    assert folder.is_dir() and "20 epochs" in repr(seen)
    del seen
    assert not folder.exists()
