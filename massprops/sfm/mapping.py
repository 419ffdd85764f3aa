"""Matching and mapping with pycolmap: SIFT with brute-force matching only, every stage seeded."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.sfm.model_bytes import write_model


@dataclass(frozen=True)
class MappingOptions:
    """How images are matched and mapped.

    Attributes:
        mapper: `incremental` or `global`.
        fixed_intrinsics: the camera is given and stays as it is.
        constant: where only some are given, their COLMAP numbers.
        free_distortion: the radial term is estimated while mapping.
        masked: features lie on one object only, so planes and frames of text are no reason to reject a pair.
        guided: second round of matching along epipolar lines.
        least_inliers: points that must agree on the place of an image.
        least_matches: matches that must agree on two images' geometry.
        start_inliers: matches of the pair that begins a model.
        ratio: of the distance between matching descriptors to that of the next best.
        most_trials: of the search for two images' geometry.
        seed, threads: as in every stage.
    """

    mapper: str = "incremental"
    fixed_intrinsics: bool = False
    constant: frozenset[int] = frozenset()
    free_distortion: bool = False
    masked: bool = False
    guided: bool = False
    least_inliers: int = 30
    least_matches: int = 15
    start_inliers: int = 100
    ratio: float = 0.8
    most_trials: int = 10_000
    seed: int = 0
    threads: int = 2


def quiet() -> None:
    """Only errors of COLMAP reach the terminal."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.ERROR.value)
    pycolmap.logging.stderrthreshold = pycolmap.logging.Level.ERROR


def match(database: Path, pairs: list[tuple[str, str]], options: MappingOptions) -> None:
    """Matches and verifies the named pairs."""
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = options.threads
    matching.use_gpu = False
    matching.guided_matching = options.guided
    matching.sift.max_ratio = options.ratio
    pairing = pycolmap.ImportedPairingOptions()
    listing = database.parent / "pairs.txt"
    pairing.match_list_path = listing
    listing.write_text("".join(f"{a} {b}\n" for a, b in pairs))
    pycolmap.match_image_pairs(database, matching, pairing, verification(options), pycolmap.Device.cpu)
    listing.unlink(missing_ok=True)


def verification(options: MappingOptions) -> pycolmap.TwoViewGeometryOptions:
    """How the geometry of a pair is found, and how many matches must agree on it."""
    out = pycolmap.TwoViewGeometryOptions()
    out.detect_watermark = not options.masked
    out.min_num_inliers = options.least_matches
    out.ransac.random_seed = options.seed
    out.ransac.max_num_trials = options.most_trials
    return out


def verify(
    database: Path, ids: dict[str, int], matches: dict[tuple[str, str], np.ndarray], options: MappingOptions
) -> None:
    """Writes matches (m, 2) of named pairs into the database, and verifies those pairs that have enough.

    Args:
        ids: numbers of the images by name.
    """
    with pycolmap.Database.open(database) as db, pycolmap.DatabaseTransaction(db):
        for (a, b), m in matches.items():
            if len(m):
                db.write_matches(ids[a], ids[b], m)
    enough = {pair: m for pair, m in matches.items() if len(m) >= options.least_matches}
    if not enough:
        return
    listing = database.parent / "pairs.txt"
    listing.write_text("".join(f"{a} {b}\n" for a, b in enough))
    pycolmap.verify_matches(database, listing, verification(options))
    listing.unlink(missing_ok=True)


def pipeline_options(options: MappingOptions, frames: Path) -> pycolmap.IncrementalPipelineOptions:
    """Incremental mapping with few global adjustments, since ours follow; never moves a given camera or rig."""
    o = pycolmap.IncrementalPipelineOptions()
    o.num_threads = options.threads
    o.random_seed = options.seed
    o.mapper.random_seed = options.seed
    o.triangulation.random_seed = options.seed
    o.image_path = frames
    o.extract_colors = False
    o.min_model_size = 3
    o.mapper.abs_pose_min_num_inliers = options.least_inliers
    o.mapper.init_min_num_inliers = options.start_inliers
    o.min_num_matches = options.least_matches
    o.max_num_models = 5
    o.init_num_trials = 100
    o.ba_refine_sensor_from_rig = False
    o.ba_refine_focal_length = not options.fixed_intrinsics
    o.mapper.abs_pose_refine_focal_length = not options.fixed_intrinsics
    o.ba_refine_extra_params = options.free_distortion and not options.fixed_intrinsics
    o.mapper.abs_pose_refine_extra_params = o.ba_refine_extra_params
    o.constant_cameras = set(options.constant)
    o.ba_global_frames_ratio = 1.3
    o.ba_global_points_ratio = 1.3
    o.ba_global_max_refinements = 2
    o.ba_global_max_num_iterations = 30
    # with tolerances of 1e-4 mapping costs 3 s of 19 less, but of a body in foil (Blender) 49 of 81 images were right in place of all
    o.ba_global_function_tolerance = 1e-6
    o.ba_local_max_num_iterations = 20
    o.ba_local_function_tolerance = 1e-5
    return o


def map_images(
    database: Path,
    frames: Path,
    out: Path,
    options: MappingOptions,
    total: int,
    progress: Progress = silent,
) -> list[pycolmap.Reconstruction]:
    """All models found, the one with most images first.

    Raises:
        NotPossible: no pair of images to start from.
    """
    pycolmap.set_random_seed(options.seed)
    out.mkdir(parents=True, exist_ok=True)
    if options.mapper == "global":
        models = _global(database, frames, out, options)
    else:
        done = [0]

        def started() -> None:
            done[0] += 2
            progress(min(done[0], total), total, "mapping")

        def added() -> None:
            done[0] += 1
            progress(min(done[0], total), total, "mapping")

        models = pycolmap.incremental_mapping(
            database,
            frames,
            out,
            pipeline_options(options, frames),
            initial_image_pair_callback=started,
            next_image_callback=added,
        )
    largest_first = sorted(models.values(), key=lambda m: (-m.num_reg_images(), -m.num_points3D()))
    if not largest_first:
        raise NotPossible(
            "structure from motion found no pair of images to start from: too few features in common or no parallax; "
            "use more overlap and texture, and make sure that the body turns or the camera moves around it"
        )
    return largest_first


def continue_mapping(
    model: pycolmap.Reconstruction, database: Path, frames: Path, out: Path, options: MappingOptions
) -> pycolmap.Reconstruction:
    """The model with the images that the database's matches now add to it; itself where they add none."""
    start = out / "start"
    write_model(model, start)
    pycolmap.set_random_seed(options.seed)
    chosen = replace(options, least_inliers=max(options.least_inliers // 2, 6))
    models = pycolmap.incremental_mapping(database, frames, out, pipeline_options(chosen, frames), input_path=start)
    most = max(models.values(), key=lambda m: m.num_reg_images(), default=model)
    return most if most.num_reg_images() > model.num_reg_images() else model


def _global(database: Path, frames: Path, out: Path, options: MappingOptions) -> dict[str, Any]:
    if not options.fixed_intrinsics:
        view = pycolmap.ViewGraphCalibrationOptions()
        if hasattr(view, "random_seed"):
            view.random_seed = options.seed
        pycolmap.calibrate_view_graph(database, view)
    o = pycolmap.GlobalPipelineOptions()
    o.num_threads = options.threads
    o.random_seed = options.seed
    o.image_path = frames
    m = o.mapper
    m.num_threads = options.threads
    m.random_seed = options.seed
    m.refine_sensor_from_rig = False
    m.rotation_averaging.random_seed = options.seed
    m.global_positioning.random_seed = options.seed
    m.global_positioning.use_gpu = False
    m.bundle_adjustment.ceres.use_gpu = False
    m.bundle_adjustment.refine_focal_length = not options.fixed_intrinsics
    m.bundle_adjustment.refine_extra_params = options.free_distortion and not options.fixed_intrinsics
    m.bundle_adjustment.refine_sensor_from_rig = False
    m.retriangulation.random_seed = options.seed
    models: dict[str, Any] = pycolmap.global_mapping(database, frames, out, o)
    return models


def retriangulate(
    model: pycolmap.Reconstruction, database: Path, frames: Path, out: Path, options: MappingOptions
) -> pycolmap.Reconstruction:
    """Builds all tracks anew from every verified match, with the poses held: pairs added later join tracks here."""
    out.mkdir(parents=True, exist_ok=True)
    o = pipeline_options(options, frames)
    return pycolmap.triangulate_points(model, database, frames, out, clear_points=True, options=o)
