"""`massprops simulate`: a sequence folder with images and truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.files import write_image
from massprops.core.progress import Progress, silent
from massprops.dynamics.inertia import ratios
from massprops.errors import InputError
from massprops.native import encode
from massprops.sequence import Camera, Environment, RangeSeries, Sequence, write_sequence
from massprops.simulation.folder import new_sequence
from massprops.simulation.scenario import Scenario, load_scenario

if TYPE_CHECKING:
    from massprops.mass.properties import MassProperties


def simulate(
    scenario: str | Path,
    out: str | Path,
    video: bool = False,
    progress: Progress = silent,
    force: bool = False,
    **changes: Any,
) -> Path:
    """Renders a scenario into a sequence folder.

    Args:
        scenario: name, YAML file, or mesh file.
        out: folder; made, or refused when it holds something else than an earlier simulation. The sequence appears in
            it whole when it is done.
        video: also write `cam0/video.mp4`.
        progress: told of each frame.
        force: other files in the folder may be replaced; the scenario's own may not.
        changes: fields of `Scenario`.

    Returns:
        the folder.

    Raises:
        InputError: an unknown scenario, a value out of range, a mesh that is no closed body, or no place to write.
    """
    if is_tracks(scenario):
        if video:
            raise InputError(f"{scenario}: a scenario of tracks has no images, so no video: leave --video out")
        return _tracks(scenario, out, progress, force, changes)
    scene = _scene(scenario, changes)
    size = scene.chosen.size
    if video and any(v % 2 for v in size):
        raise InputError(f"size {size[0]}x{size[1]}: H.264 needs even numbers; give such a --size")
    with new_sequence(Path(out), (scene.chosen, scene.active, scene.model), scene.read, force) as folder:
        _render(scene, folder, video, progress)
    return Path(out)


def _tracks(scenario: str | Path, out: str | Path, progress: Progress, force: bool, changes: dict[str, Any]) -> Path:
    """A scenario of tracks, written into its folder."""
    from massprops.simulation.track_scenario import track_scenario
    from massprops.simulation.tracks import write_tracks

    given = _tracks_file(scenario)
    given.update({TRACK_NAMES.get(k, k): v for k, v in changes.items() if v is not None})
    read = [Path(p) for p in (scenario, given.get("model")) if p is not None]
    folder = write_tracks(track_scenario(given, str(scenario)), out, read, force)
    progress(1, 1, "tracks")
    return folder


@dataclass(frozen=True)
class _Scene:
    """A scenario of images with its body and motion.

    Attributes:
        chosen: the scenario; acting: its effects as given; read: the files it came from.
        mesh: about its centre of mass [m]; body: its mass properties; length: its greatest length.
        path: of the motion; model: the effects that act, None without any.
    """

    chosen: Scenario
    active: tuple[str, ...]
    read: list[Path]
    mesh: Any
    body: MassProperties
    length: float
    path: Any
    model: Any


def _scene(scenario: str | Path, changes: dict[str, Any]) -> _Scene:
    """Reads the body and moves it."""
    from massprops.exchange.mesh_files import read_solid
    from massprops.mass.integrals import greatest_length
    from massprops.mass.properties import mass_properties
    from massprops.simulation.motion import tumbling, walk_round, with_hidden_mass

    active = tuple(changes.pop("effects", None) or ())
    model_file = changes.pop("model", None)
    chosen = load_scenario(scenario, **changes)
    mesh = read_solid(chosen.mesh)[0].copy()
    mesh.apply_translation(-mass_properties(mesh, 1.0).center_of_mass)
    body = mass_properties(mesh, chosen.density)
    length = greatest_length(np.asarray(mesh.vertices))[0]
    inertia, centre = body.inertia, np.zeros(3)
    if chosen.hidden_mass is not None:
        inertia, centre = with_hidden_mass(body.inertia, body.mass, chosen.hidden_mass)
    path = (tumbling if chosen.motion == "tumbling" else walk_round)(chosen, inertia, length, centre)
    model = None
    if active or model_file is not None:
        path, model = _under_effects(chosen, path, active, model_file, length)
    read = [Path(p) for p in (scenario, chosen.mesh, model_file) if p is not None]
    return _Scene(chosen=chosen, active=active, read=read, mesh=mesh, body=body, length=length, path=path, model=model)


def _render(scene: _Scene, folder: Path, video: bool, progress: Progress) -> None:
    """Writes images, measurements and truth into a folder."""
    from massprops.simulation.render import Renderer, lens_of

    chosen, path, mesh = scene.chosen, scene.path, scene.mesh
    lens = lens_of(chosen)
    renderer = Renderer(mesh, chosen, lens)
    rng = np.random.default_rng([chosen.seed, 3])
    baselines = [0.0] + ([chosen.stereo_m] if chosen.stereo_m > 0 else [])
    seen = np.zeros(len(mesh.faces), int)
    images: dict[int, list[tuple[int, Path]]] = {k: [] for k in range(len(baselines))}
    for k in range(len(baselines)):
        (folder / f"cam{k}" / "data").mkdir(parents=True)
    for i, stamp in enumerate(path.timestamp_ns.tolist()):
        for k, baseline in enumerate(baselines):
            image, lit = renderer.frame(path.q[i], path.position[i] - [baseline, 0, 0], path.sun[i], rng)
            if k == 0:
                seen[lit] += 1
            images[k].append((stamp, _save(folder / f"cam{k}" / "data" / f"{stamp:019d}.png", image)))
        progress(i + 1, chosen.frames, "frames")
    cameras = {k: _camera(chosen, lens, baseline, tuple(images[k])) for k, baseline in enumerate(baselines)}
    sequence = Sequence(cameras=cameras, range=_ranges(chosen, path, rng), environment=Environment())
    truth = _truth(chosen, scene.body, path, scene.length, float(mesh.area_faces[seen >= 3].sum() / mesh.area))
    if scene.model is not None:
        from massprops.model import document_of

        truth["effects"] = {e["name"]: e["parameters"] for e in document_of(scene.model)["effects"]}
    write_sequence(folder, sequence, truth)
    mesh.export(folder / "truth" / "mesh.ply")
    if video:
        write_video(folder / "cam0" / "video.mp4", [p for _, p in images[0]], chosen.rate_hz)


TRACK_NAMES = {"stereo_m": "baseline_m"}
"""Options of rendering that mean the same for tracks under another name."""


def is_tracks(scenario: str | Path) -> bool:
    """Whether a scenario asks for tracks only: the name `tracks`, or a YAML file with `kind: tracks`."""
    return str(scenario) == "tracks" or _tracks_file(scenario).get("kind") == "tracks"


def _tracks_file(scenario: str | Path) -> dict[str, Any]:
    from massprops.documents.loading import load_yaml

    path = Path(scenario)
    return load_yaml(path) if path.suffix.lower() in (".yaml", ".yml") and path.is_file() else {}


def _under_effects(
    scenario: Scenario, path: Any, active: tuple[str, ...], model_file: Any, length: float
) -> tuple[Any, Any]:
    """The path as effects make it, and the model of them."""
    from dataclasses import replace

    from massprops.dynamics.environment import EnvironmentModel
    from massprops.dynamics.quaternion import rotation_matrix
    from massprops.model import Model
    from massprops.model.state import BatchState
    from massprops.simulation.effect_size import effects_model, moved_by

    if scenario.motion != "tumbling":
        raise InputError("effects act on a tumbling body: choose a scenario with motion: tumbling")
    rng = np.random.default_rng([scenario.seed, 15])
    points = rng.standard_normal((12, 3))
    points *= 0.4 * length / np.linalg.norm(points, axis=1, keepdims=True)
    still = path.centre_in_camera[0]
    whole = 3.0 * path.inertia / np.trace(path.inertia)
    state = BatchState(path.q[0], path.w[0], still, np.zeros(3), whole, Model(), points)
    times = (path.timestamp_ns - path.timestamp_ns[0]) * 1e-9
    environment = EnvironmentModel(Environment())
    model = effects_model(
        active, model_file, times, state, scenario.focal * scenario.size[0], environment, scenario.seed
    )
    q, w, r = moved_by(times, state, model, environment)
    sun = np.einsum("nij,nj->ni", rotation_matrix(path.q), path.sun)
    sun_body = np.einsum("nji,nj->ni", rotation_matrix(q), sun)
    return replace(path, q=q, w=w, position=r - rotation_matrix(q) @ path.centre, sun=sun_body), model


def _save(path: Path, image: np.ndarray) -> Path:
    import cv2

    write_image(path, image, (cv2.IMWRITE_PNG_COMPRESSION, 3))
    return path


def _camera(scenario: Scenario, lens: Any, baseline: float, images: tuple[tuple[int, Path], ...]) -> Camera:
    pose = np.eye(4)
    pose[0, 3] = baseline
    return Camera(
        resolution=scenario.size,
        intrinsics=np.array([lens.K[0, 0], lens.K[1, 1], lens.K[0, 2], lens.K[1, 2]]),
        distortion=lens.distortion,
        T_BS=pose,
        rate_hz=scenario.rate_hz,
        images=images,
    )


def _ranges(scenario: Scenario, path: Any, rng: np.random.Generator) -> RangeSeries | None:
    if scenario.range_sigma_m <= 0:
        return None
    distance = np.linalg.norm(path.centre_in_camera, axis=1)
    return RangeSeries(
        path.timestamp_ns,
        distance + scenario.range_sigma_m * rng.standard_normal(len(distance)),
        scenario.range_sigma_m,
    )


def _truth(scenario: Scenario, body: Any, path: Any, length: float, seen: float) -> dict[str, Any]:
    motion, properties = ratios(path.inertia)[0], body.values()
    return {
        "timestamp_ns": path.timestamp_ns,
        "position": path.position,
        "q": path.q,
        "w": path.w,
        "mesh": "mesh.ply",
        "density": body.density,
        **{key: properties[key] for key in ("volume", "mass")},
        "centre_of_mass_m": [0.0, 0.0, 0.0],
        **{key: properties[key] for key in ("inertia", "principal_moments", "principal_axes")},
        **properties["inertia_ratios"],
        "motion_centre_of_mass_m": path.centre.tolist(),
        "motion_inertia": path.inertia.tolist(),
        "motion_k1": float(motion[0]),
        "motion_k2": float(motion[1]),
        "greatest_length_m": length,
        "seen_lit_share": seen,
        "sun_body_first_frame": path.sun[0].tolist(),
        "seed": scenario.seed,
        "motion": scenario.motion,
    }


def write_video(path: Path, images: list[Path], rate_hz: float, crf: int = 15) -> None:
    """H.264 of grey images."""
    import cv2

    grey = (np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)) for file in images)
    encode(path, grey, rate_hz, "libx264", "yuv420p", {"crf": str(crf), "preset": "slow"})
