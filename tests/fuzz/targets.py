"""What is fuzzed: for each target a few good files, and a reader that is given one of them changed.

A target is a function `read(folder, name, data)`; it writes `data` under `name` beside good files and reads the whole.
"""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import yaml

from massprops.sequence import (
    AttitudeSeries,
    Body,
    Camera,
    Environment,
    Orbit,
    RangeSeries,
    RateSeries,
    Sequence,
    Tracks,
    write_sequence,
)

from .model_targets import model_targets
from .run_targets import run_targets


@dataclass(frozen=True)
class Target:
    """seeds: good content by file name; read: what is done with the folder; around: makes the folder's other files."""

    seeds: dict[str, list[bytes]]
    read: Callable[[Path, str], object]
    around: Callable[[Path], object] | None = None


def sequence() -> Sequence:
    t = np.arange(12, dtype=np.int64) * 10**8
    camera = Camera((640, 480), np.array([800.0, 800, 320, 240]), np.array([0.1, 0, 0, 0]), sigma_px=0.3, rate_hz=10.0)
    return Sequence(
        cameras={0: camera},
        tracks=Tracks(np.repeat(t, 4), np.zeros(48, int), np.tile([4, 7, 8, 9], 12), np.arange(96.0).reshape(48, 2)),
        range=RangeSeries(t, np.linspace(10, 11, 12), 0.05),
        rates=RateSeries(t, np.arange(36.0).reshape(12, 3), 0.01),
        attitude=AttitudeSeries(t, np.tile([0.6, 0.8, 0, 0], (12, 1)), np.full(12, 1e-3)),
        body=Body(np.diag([1.0, 2.0, 2.5]), source="test", mass_kg=3.0, centre_of_mass_m=np.zeros(3)),
        environment=Environment("lvlh", Orbit(3.986e14, 7e6, 0.01, 0.3), np.array([0, 0, 1.0]), np.array([1e-5, 0, 0])),
    )


def _write(folder: Path, name: str, data: bytes) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)


def _sequence_seeds(*names: str) -> dict[str, list[bytes]]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        write_sequence(place, sequence())
        return {name: [(Path(place) / name).read_bytes()] for name in names}


def _read_sequence(folder: Path, name: str) -> object:
    from massprops.model.problem import problem_of
    from massprops.sequence.read import read_sequence

    return problem_of(read_sequence(folder))


def _scenario(folder: Path, name: str) -> object:
    from massprops.simulation.scenario import load_scenario
    from massprops.simulation.simulate import is_tracks
    from massprops.simulation.track_scenario import track_scenario

    path = folder / name
    if is_tracks(path):
        from massprops.documents.loading import load_yaml

        return track_scenario(load_yaml(path), str(path))
    return load_scenario(path)


def _campaign(folder: Path, name: str) -> object:
    from massprops.campaigns.configuration import check_size, read_configuration

    plan = read_configuration(folder / name)
    check_size(plan, False)
    return plan


def _model(folder: Path, name: str) -> object:
    from massprops.model import load_model

    return load_model(folder / name)


def _filter(folder: Path, name: str) -> object:
    from massprops.estimators.prior import read_filter

    return read_filter(folder / name)


def _mesh(folder: Path, name: str) -> object:
    from massprops.exchange.mesh_files import in_metres, read_solid
    from massprops.mass.properties import mass_properties

    solid, _ = read_solid(folder / name)
    return mass_properties(in_metres(solid, "auto", 1.0)[0])


def _run(folder: Path, name: str) -> object:
    from massprops.consistency.fusion import read_draws
    from massprops.consistency.mesh_side import read_mesh_side
    from massprops.exchange.body import read_body
    from massprops.exchange.formats import formats

    side = read_mesh_side(folder)
    read_draws(folder, side)
    body = read_body(folder)
    return [f.render(body, {}) for f in formats().values() if body.metric or not f.NEEDS_METRES]


def _image(folder: Path, name: str) -> object:
    from massprops.capture.images import inspect, load

    found = inspect(folder / name)
    return load(folder / name, 64), found


def _mask(folder: Path, name: str) -> object:
    from massprops.capture.given import load_mask

    return load_mask(folder / name, (16, 12), (16, 12))


def _video(folder: Path, name: str) -> object:
    from massprops.capture.video import read_video

    return [frame for _, frame in zip(range(8), read_video(folder / name, 64), strict=False)]


def _options(folder: Path, name: str) -> object:
    """Each line is one argument of a command."""
    from massprops.errors import InputError
    from massprops_cli.main import run

    lines = (folder / name).read_bytes().decode(errors="replace").replace("\0", "").split("\n")
    code = run([line for line in lines if line])
    if code not in (0, 2, 3):
        raise AssertionError(f"exit {code}")
    raise InputError("the command said what it had to say")


def _box_run(folder: Path) -> None:
    from massprops.mass.document import document
    from massprops.mass.properties import mass_properties

    write_sequence(folder / "sequence", sequence())
    mesh = trimesh.creation.box((1.0, 2.0, 3.0))
    mesh.export(folder / "mesh.ply")
    found = mass_properties(mesh)
    k = {"k1": [found.k1 - 0.01, found.k1 + 0.01], "k2": [found.k2 - 0.01, found.k2 + 0.01]}
    scale = {"source": "given", "metres_per_unit": 2.0, "relative_sigma": 0.01}
    content = document(found, k, scale, {"observed_fraction": 1.0, "watertight": True, "area": 22.0}, [])
    (folder / "massprops.json").write_text(json.dumps(content, indent=1))
    (folder / "work" / "scale").mkdir(parents=True)
    (folder / "work" / "scale" / "scale.json").write_text('{"metres_per_unit": 2.0, "unit_per_sfm": 0.5, "seed": 1}')
    (folder / "work" / "sfm").mkdir()
    np.savez(folder / "work" / "sfm" / "points.npz", id=np.arange(4, 10), xyz=np.arange(18.0).reshape(6, 3))
    (folder / "work" / "surface").mkdir()
    rows = np.tile([6.0, 0, 0, 0, 0.5, 2.0, 4.5, 0, 0, 0], (60, 1)) * (1 + 1e-3 * np.arange(60))[:, None]
    np.savez(
        folder / "work" / "surface" / "surface.npz",
        vertices=mesh.vertices, faces=mesh.faces, observed=np.ones(12, bool), replicate_integrals=rows,
        replicate_length=np.full(60, 3.7),
    )  # fmt: skip


def _run_seeds() -> dict[str, list[bytes]]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _box_run(folder)
        names = ("massprops.json", "mesh.ply", "work/scale/scale.json", "work/sfm/points.npz", "work/surface/surface.npz",
                 "sequence/attitude0/data.csv")  # fmt: skip
        return {name: [(folder / name).read_bytes()] for name in names}


def _mesh_seeds() -> dict[str, list[bytes]]:
    made: dict[str, list[bytes]] = {}
    two = trimesh.util.concatenate([trimesh.creation.box(), trimesh.creation.box((0.3, 0.3, 5.0))])
    for mesh in (trimesh.creation.box(), two):
        for kind in ("stl", "stl_ascii", "obj", "ply", "off", "glb"):
            data = mesh.export(file_type=kind)
            made.setdefault(f"mesh.{kind.split('_')[0]}", []).append(data.encode() if isinstance(data, str) else data)
    return made


def _image_seeds() -> dict[str, list[bytes]]:
    from PIL import Image

    rng = np.random.default_rng(0)
    image = Image.fromarray(rng.integers(0, 255, (12, 16, 3)).astype(np.uint8))
    exif = Image.Exif()
    exif[0x0112], exif[0x0132] = 6, "2024:01:02 03:04:05"
    exif.get_ifd(0x8769).update({0xA405: 35, 0x920A: 50.0, 0x9003: "2024:01:02 03:04:05"})
    out = {}
    for kind in ("jpg", "png", "tif", "bmp", "webp"):
        file = io.BytesIO()
        image.save(file, {"jpg": "jpeg", "tif": "tiff"}.get(kind, kind), exif=exif)
        out[f"image.{kind}"] = [file.getvalue()]
    return out


def _video_seeds() -> dict[str, list[bytes]]:
    import av

    out = {}
    for kind, codec in (("mp4", "libx264"), ("avi", "mpeg4"), ("mkv", "mpeg4")):
        file = io.BytesIO()
        with av.open(file, "w", format={"mkv": "matroska"}.get(kind, kind)) as container:
            stream = container.add_stream(codec, rate=10)
            stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
            for i in range(6):
                picture = np.full((32, 32, 3), 30 * i, np.uint8)
                for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")):
                    container.mux(packet)
            for packet in stream.encode():
                container.mux(packet)
        out[f"video.{kind}"] = [file.getvalue()]
    return out


def _turning(number: int) -> np.ndarray:
    """(120, 160, 3) uint8: a textured square, turned, before black sky."""
    import cv2

    patch = np.random.default_rng(0).integers(60, 255, (14, 14, 3)).astype(np.uint8)
    out = np.zeros((120, 160, 3), np.uint8)
    out[25:95, 45:115] = cv2.resize(patch, (70, 70), interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.warpAffine(out, cv2.getRotationMatrix2D((80, 60), 8.0 * number, 1.0), (160, 120)))


def _encoded(number: int) -> bytes:
    import cv2

    return bytes(cv2.imencode(".png" if number % 2 else ".jpg", _turning(number))[1])


def _photographs_around(folder: Path) -> None:
    for number in range(6):
        _write(folder, f"in/{number}.{'png' if number % 2 else 'jpg'}", _encoded(number))


def _capture_seeds() -> dict[str, list[bytes]]:
    import av

    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for number in range(8):
            for packet in stream.encode(av.VideoFrame.from_ndarray(_turning(number), format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return {"in/0.jpg": [_encoded(0)], "in/1.png": [_encoded(1)], "v.mp4": [file.getvalue()]}


def _capture(folder: Path, name: str) -> object:
    """The whole capture stage, over a video or over photographs of which one is changed."""
    import tempfile

    from massprops.run.job import Job, ReconstructOptions
    from massprops.run.stages import capture

    source = folder / name if name.endswith("mp4") else folder / "in"
    with tempfile.TemporaryDirectory() as place:
        options = ReconstructOptions(source=str(source), frames=8, max_size=160)
        return capture.run(Job(run=Path(place), options=options, out=Path(place)))


def _dump(content: object) -> bytes:
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None).encode()


def _documents() -> dict[str, Target]:
    eye = np.eye(3).tolist()
    effect = {"name": "viscous-damping", "parameters": {"rate": 1e-4}, "units": {"rate": "1/s"}}
    model = {"format": "massprops-model/1", "effects": [effect], "inertia": np.diag([0.8, 1.0, 1.2]).tolist()}
    prior = {
        "format": "massprops-filter/1", "inertia": np.diag([0.3, 0.33, 0.37]).tolist(), "principal_axes": eye,
        "inertia_ratios": {"k1": float(np.log(0.3 / 0.33)), "k2": float(np.log(0.33 / 0.37))},
        "k_covariance": (1e-4 * np.eye(2)).tolist(), "axes_covariance_rad2": (1e-4 * np.eye(3)).tolist(),
        "frame": {"kind": "x", "mark": [[1_000_000_000, 1.0, 0, 0, 0]]},
        "features": {"ids": [1, 2, 3, 4], "xyz": np.arange(12.0).reshape(4, 3).tolist(), "units": "m", "sigma": 0.01},
        "process_noise": 1e-5,
    }  # fmt: skip
    scenario = b"mesh: asteroid.stl\nmotion: tumbling\nframes: 8\nsize: [96, 72]\nspin: [1, 2, 3]\nhidden_mass: [0.1, 0, 1, 0]\n"
    tracks = (
        b"kind: tracks\nframes: 8\nfeatures: 6\nmoments: [1, 2, 2.5]\nspin: [0, 1, 0]\neffects: [viscous-damping:6]\n"
    )
    campaign = {"kind": "drill", "runs": 3, "seed": 1, "chunk": 2, "grid": {"sigma": [0.1, 0.2]},
                "draw": {"draws": {"integer": [2, 5]}}, "limits": {"time_s": 9}}  # fmt: skip
    estimate = {"kind": "estimate", "runs": 2, "estimator": "ekf", "frames": 20, "grid": {"rate_deg": [1, 2]}}
    return {
        "model": Target({"model.yaml": [_dump(model)]}, _model),
        "filter": Target({"prior.yaml": [_dump(prior)]}, _filter),
        "scenario": Target({"scenario.yaml": [scenario, tracks]}, _scenario),
        "campaign": Target({"study.yaml": [_dump(campaign), _dump(estimate)]}, _campaign),
    }


OPTIONS = [
    "mass\nnothing.stl\n-o\nout\n--density\n2.5\n--scale\n0.1", "export\nnothing\n--to\nurdf\n--mass\n3",
    "compare\na.stl\nb.stl\n--cad-unit\nmm\n--json", "estimate\nseq\n-o\nout\n--method\nekf\n-q",
    "simulate\nnothing\n-o\nout\n--size\n64x48\n--distortion\n0.1,0.2\n--hidden-mass\n0.1:1,2,3",
    "reconstruct\nnothing.mp4\n-o\nout\n--frames\n10\n--scale\n0.4", "diagnose\nseq\n-o\nout", "campaign\nstudy.yaml\n-o\nout",
    "crosscheck\nrun\n-q", "reproduce\n--help", "doctor\n--help",
]  # fmt: skip


def _sequence_around(folder: Path) -> None:
    write_sequence(folder, sequence())


def targets() -> dict[str, Callable[[], Target]]:
    """Every target by its name; made when asked for, since seeds of some take a moment."""
    tables = ("tracks0/data.csv", "range0/data.csv", "imu0/data.csv", "attitude0/data.csv")
    yamls = ("cam0/sensor.yaml", "range0/sensor.yaml", "imu0/sensor.yaml", "body.yaml", "environment.yaml")
    made: dict[str, Callable[[], Target]] = {
        "tables": lambda: Target(_sequence_seeds(*tables), _read_sequence, _sequence_around),
        "sequence-yaml": lambda: Target(_sequence_seeds(*yamls), _read_sequence, _sequence_around),
        "meshes": lambda: Target(_mesh_seeds(), _mesh),
        "runs": lambda: Target(_run_seeds(), _run, _box_run),
        "images": lambda: Target(_image_seeds(), _image),
        "capture": lambda: Target(_capture_seeds(), _capture, _photographs_around),
        "masks": lambda: Target(_image_seeds(), _mask),
        "videos": lambda: Target(_video_seeds(), _video),
        "options": lambda: Target({"options.txt": [o.encode() for o in OPTIONS]}, _options),
    }
    made |= run_targets(Target) | model_targets(Target)
    for name in ("model", "filter", "scenario", "campaign"):
        made[name] = lambda name=name: _documents()[name]
    return made


def fresh(target: Target, folder: Path) -> None:
    """The folder with the target's good files and nothing else."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if target.around is not None:
        target.around(folder)


def restore(target: Target, folder: Path, name: str) -> None:
    """Takes a changed file back; the target's other files are as they were."""
    good = target.seeds[name][0]
    if target.around is None:
        (folder / name).unlink(missing_ok=True)
    else:
        _write(folder, name, good)
