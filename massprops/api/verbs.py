"""What massprops does, as functions. Options have the names and defaults of the command line, which takes them from here.

A source is a path or what such a function gave; where it says so, arrays. `out` is a folder to keep the result in;
without it nothing is left on disk. `force` lets files in `out` be replaced that massprops did not write. `progress` is
told `(what, done, total)`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from massprops.api.options import (
    ARRAYS,
    OF_RUN,
    RECONSTRUCT,
    SIMULATE,
    ArrayOptions,
    ReconstructOptions,
    SimulateOptions,
    filled,
    with_options,
)

if TYPE_CHECKING:
    import numpy as np
    import trimesh

    from massprops.api.results import Campaign, Diagnosis, Estimates, Simulation, Solid
    from massprops.consistency.crosscheck import CrossCheck
    from massprops.estimators.result import Prior
    from massprops.exchange.compare import Comparison
    from massprops.report.masks_page import Sheet
    from massprops.run.reconstruct import Run
    from massprops.sequence import Sequence as Recording

    Place = str | PathLike[str]
    Progress = Callable[[str, int, int], None]


@with_options(ReconstructOptions, RECONSTRUCT)
def reconstruct(
    source: Place | Sequence[Place] | np.ndarray, out: Place | None = None, **options: Unpack[ReconstructOptions]
) -> Run:
    """Mesh, volume, centre of mass and inertia, each with its interval, from a video or photographs of an object.

    Args:
        source: video, folder of images, or sequence folder; several: placements of one object, turned over between.
            In Python also: frames in memory, (n, h, w) grey or (n, h, w, 3) red, green, blue, uint8, in the order of time.
        out: run folder; the same command continues an interrupted run.
        motion: how it was filmed: auto, tumbling (body moves, camera still) or static (camera moves).
        masks: silhouettes in COLMAP's naming: IMAGE.jpg.png, black excluded.
        object: a pixel of the object as "X,Y" of the first image used, or "FILE:X,Y"; may be several.
        box: a rectangle in which the object lies, "X0,Y0,X1,Y1" of the first image used, or "FILE:X0,Y0,X1,Y1".
        keep_support: a stand, foam or mat below the object belongs to it.
        frames: most frames used per camera.
        max_size: longer side to which images are reduced [px].
        focal: focal length of the source images, when known [px].
        mapper: way to place the images: incremental or global.
        sparse: existing COLMAP model to use in place of our own.
        dense_views: most reference views of the dense stereo; 0: chosen.
        density: constant density [kg/m^3]; not given: 1000, as water, and said so.
        scale: the object's greatest length, from tip to tip [m]; not given: it is the unit, and only ratios are claimed.
        scale_sigma: relative 1-sigma of a given length.
        distance: distance between two points, each "x,y,z" in model units or a picked name, and the metres.
        marker: ArUco DICTIONARY:SIDE_METRES or ChArUco DICTIONARY:COLSxROWS:SQUARE_METRES in view.
        seed: of every random draw.
        threads: processor threads; 0: all.
        force: replace files that this command did not write; never an input.
        rate_hz: frames a second, of frames in memory.
        progress: told of each stage.

    Returns:
        the run. Where the data did not give everything its `exit_code` is 3 and `reason` says why.

    Raises:
        InputError: the input or an option is wrong.

    Example:
        >>> run = massprops.reconstruct("video.mp4", scale=0.42, density=2700)  # doctest: +SKIP
        >>> run.volume, run.interval["volume"], run.confidence  # doctest: +SKIP
        (0.00163, array([0.0016 , 0.00166]), 'high')
        >>> run.mesh.show()  # doctest: +SKIP
    """
    from massprops.api.results import Kept
    from massprops.api.sources import footage
    from massprops.run.reconstruct import reconstruct as run_reconstruct

    given = filled(reconstruct, options)
    of_run = {name: given[name] for name in OF_RUN}
    progress: Progress | None = given["progress"]
    kept = Kept(_path(out))
    watch = None if progress is None else lambda stage, number, count, done, total, what: progress(stage, done, total)
    with footage(source, given["rate_hz"]) as read:
        run = run_reconstruct(read, kept.folder / ("run" if out is None else ""), watch, given["force"], **of_run)
    run.__dict__["_kept"] = kept
    return run


def mass_properties(
    mesh: Place | trimesh.Trimesh,
    out: Place | None = None,
    *,
    density: float | None = None,
    scale: float = 1.0,
    scale_sigma: float = 0.0,
    force: bool = False,
) -> Solid | Run:
    """Volume, centre of mass and inertia of a finished mesh.

    Args:
        mesh: closed mesh: STL, OBJ, PLY, GLB or OFF. Small defects are repaired with a warning. In Python also: a
            `trimesh.Trimesh`.
        out: run folder, with the same report and exports as a reconstruction.
        density: constant density [kg/m^3]; not given: 1000, as water, and said so.
        scale: metres per unit of the file; 0.001 for millimetres.
        scale_sigma: relative 1-sigma of the scale.
        force: replace files and results that this command did not write; never the mesh.

    Raises:
        InputError: not a closed body, or a value out of range.

    Example:
        >>> import trimesh
        >>> body = massprops.mass_properties(trimesh.creation.box((1, 2, 3)), density=2.0)
        >>> round(body.volume, 9), body.principal_moments.round(9).tolist()
        (6.0, [5.0, 10.0, 13.0])
        >>> body
        <Solid: volume 6 m^3, mass 12 kg, I1 5 kg m^2, I2 10 kg m^2, I3 13 kg m^2>
    """
    from massprops.api.results import Solid
    from massprops.api.sources import mesh_file
    from massprops.run import from_mesh

    with mesh_file(mesh) as file:
        if out is not None:
            return from_mesh.mass(file, Path(out), density, scale, scale_sigma, force)
        solid, document = from_mesh.measure(file, density, scale, scale_sigma)
        return Solid(solid, document)


def masks(run: Place | Run, out: Place | None = None, *, force: bool = False) -> Sheet:
    """A run's silhouettes at the size of the images, as files to mend and give back, and a page that shows them.

    Args:
        run: run folder.
        out: folder for the masks and the page; default: RUN-masks.
        force: replace masks that were mended there, and files of others.

    Raises:
        InputError: no silhouettes in the run, or the folder holds something else.
    """
    from massprops.api.sources import as_path
    from massprops.run.masks import masks as write_masks

    return write_masks(as_path(run), _path(out), force)


def estimate(
    source: Place | Run | Simulation | Recording,
    out: Place | None = None,
    *,
    method: str | Sequence[str] | None = None,
    prior: Place | Prior | None = None,
    model: Place | None = None,
    effect: Place | Sequence[Place] | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Estimates:
    """Motion and inertia ratios of a recording by several estimators.

    Args:
        source: sequence folder, or run folder. In Python also: what `sequence_from_arrays` made of your own arrays.
        out: folder for estimates.json, CSVs and report.html.
        method: estimator, may be several: smoother, ekf, iekf, ukf, ukf-gp, range-ukf, momentum-ls, principal-axis-ekf;
            or all, which is the default.
        prior: what 'export --to filter' wrote.
        model: what 'diagnose' wrote; for the smoother.
        effect: an effect file of your own; may be several.
        force: replace files that this command did not write; never an input.
        progress: told of each method.

    Raises:
        InputError: unknown method, unreadable recording or prior.
        NotPossible: a method asked for by name needs what the recording lacks.

    Example:
        >>> seen = massprops.simulate("tracks", frames=120, seed=3)
        >>> found = massprops.estimate(seen, method="momentum-ls")
        >>> found.verdict, abs(found.k1 - seen.truth.facts["k1"]) < 0.02
        ('observable', True)
    """
    from massprops.api.results import Estimates
    from massprops.api.sources import as_path
    from massprops.core.progress import silent
    from massprops.effect_file import with_effects
    from massprops.estimators.estimate import estimate_all
    from massprops.report.estimates import write_estimates

    given = as_path(source)
    methods = [method] if isinstance(method, str) else list(method or ["all"])
    tell = None if progress is None else lambda done, total, what: progress(what, done, total)
    with with_effects(_paths(effect)):
        outcome = estimate_all(given, methods, prior, tell or silent, model)  # type: ignore[arg-type]
    more = tuple(Path(p) for p in (prior, model) if isinstance(p, str | PathLike))

    def write(folder: Path) -> Path:
        return write_estimates(outcome, folder, given, more, force)

    if out is not None:
        write(Path(out))
    return Estimates(outcome, _path(out), write)


def crosscheck(
    run: Place | Run,
    *,
    sequence: Place | None = None,
    method: str | Sequence[str] | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> CrossCheck:
    """Do mesh and motion agree on the inertia ratios and principal axes? Writes `crosscheck.json` into the run.

    Args:
        run: run folder of `reconstruct`.
        sequence: another sequence of the same footage.
        method: estimator, may be several; or all, which is the default.
        force: replace files that this command did not write; never an input.
        progress: told of each estimator.

    Raises:
        InputError: no mass properties in the run, or a sequence that cannot be read.

    Example:
        >>> massprops.crosscheck("runs/demo").verdict  # doctest: +SKIP
        'consistent'
    """
    from massprops.api.sources import as_path
    from massprops.consistency.crosscheck import crosscheck as check
    from massprops.core.progress import silent

    methods = [method] if isinstance(method, str) else list(method or ["all"])
    tell = silent if progress is None else lambda done, total, what: progress(what, done, total)
    return check(as_path(run), as_path(sequence), methods, progress=tell, force=force)


def diagnose(
    source: Place | Run | Simulation | Recording,
    out: Place | None = None,
    *,
    more: Sequence[Place | Run | Simulation | Recording] = (),
    discover: bool = False,
    simulator: str | None = None,
    effect: Place | Sequence[Place] | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find where a free rigid body's motion and the measurements disagree, and name the missing effect.

    Args:
        source: sequence folder, or run folder. In Python also: what `sequence_from_arrays` made of your own arrays.
        out: folder for diagnosis.json, model.yaml, residual.csv and report.html.
        more: further records of the same body: they share its inertia.
        discover: look for a law of what is in no catalogue too: its formula, law.py, law.yaml.
        simulator: your own simulator, 'module:function' or 'FILE.py:function', fitted to the record as a black box.
        effect: an effect file of your own; may be several.
        force: replace files that this command did not write; never an input.
        progress: told of each step.

    Raises:
        InputError: an unreadable recording, or a body file that contradicts itself.
        NotPossible: nothing in the recording shows how the body moves.

    Example:
        >>> seen = massprops.simulate("tracks", effects=["viscous-damping:6"])  # doctest: +SKIP
        >>> massprops.diagnose(seen).effects  # doctest: +SKIP
        {'viscous-damping': {'rate': 0.00021}}
    """
    from massprops.api.results import Diagnosis
    from massprops.api.sources import as_path
    from massprops.diagnosis.search.diagnose import diagnose as search
    from massprops.diagnosis.search.diagnose import write_found
    from massprops.effect_file import with_effects

    given = as_path(source)
    if more:
        return _several([given, *map(as_path, more)], _path(out), force, progress)
    inputs = [given] if isinstance(given, Path) else []
    with with_effects(_paths(effect)):
        found = search(
            given,
            _path(out),
            **({} if progress is None else {"progress": progress}),
            force=force,
            discover=discover,
            simulator=simulator,
        )
    folder = _path(out)
    return Diagnosis(found.document, found.model, folder, lambda place: write_found(place, found, inputs, force))


def _several(records: list[Any], out: Path | None, force: bool, progress: Progress | None) -> Diagnosis:
    """The diagnosis of several records of one body."""
    from massprops.api.results import Diagnosis
    from massprops.diagnosis.diagnose import diagnose_several, write_several
    from massprops.sequence.read import read_sequence

    inputs = [r for r in records if isinstance(r, Path)]
    named = {
        str(r) if isinstance(r, Path) else f"record {k}": read_sequence(r) if isinstance(r, Path) else r
        for k, r in enumerate(records)
    }
    document = diagnose_several(named) if progress is None else diagnose_several(named, progress)
    if out is not None:
        write_several(document, out, inputs, force)
    return Diagnosis(document, {}, out, lambda place: write_several(document, place, inputs, force))


def compare(
    source: Place | Run | Solid | trimesh.Trimesh,
    cad: Place | trimesh.Trimesh,
    out: Place | None = None,
    *,
    free_scale: bool | None = None,
    cad_unit: str = "auto",
    force: bool = False,
) -> Comparison:
    """Align with a CAD mesh, then measure surface distances and the errors of every mass property.

    Args:
        source: run folder, or mesh file in metres. In Python also: a `trimesh.Trimesh`.
        cad: closed mesh: STL, OBJ, PLY, GLB or OFF. In Python also: a `trimesh.Trimesh`.
        out: folder for compare.json and the coloured mesh; a run's report shows them.
        free_scale: fit the scale too; default: when the run has none.
        cad_unit: unit of the CAD file: m, cm, mm, in, or auto.
        force: replace files that this command did not write; never an input.

    Raises:
        InputError: a file is missing or is no closed body, or `out` cannot be written.

    Example:
        >>> import trimesh
        >>> ours, cad = trimesh.creation.box((1, 2, 3.03)), trimesh.creation.box((1, 2, 3))
        >>> round(massprops.compare(ours, cad).row("volume")["relative_error"], 6)
        0.01
    """
    from massprops.api.sources import mesh_file
    from massprops.exchange.compare import compare as measure

    with mesh_file(source) as ours, mesh_file(cad) as theirs:
        return measure(ours, theirs, out=_path(out), free_scale=free_scale, cad_unit=cad_unit, force=force)


def export(
    source: Place | Run | Solid | trimesh.Trimesh,
    to: str,
    out: Place | None = None,
    *,
    density: float | None = None,
    mass: float | None = None,
    force: bool = False,
) -> Path:
    """Write mass properties for a filter or a simulator.

    Args:
        source: run folder, or mesh file in metres. In Python also: a `trimesh.Trimesh` in metres.
        to: the format: filter, urdf, mjcf, sdf, usd, basilisk, csv, json, colmap-text, nerfstudio, tum, rerun.
        out: file to write; default: in the run, or beside the mesh file, by its name. In Python a mesh in memory needs it.
        density: for a mesh [kg/m^3]; not given: 1000, as water, and said so.
        mass: measured mass [kg]; the inertia is scaled to it.
        force: replace files that this command did not write; never an input.

    Returns:
        the file written.

    Raises:
        InputError: unknown format, no mesh, no scale where metres are needed, or an impossible body.

    Example:
        >>> massprops.export("runs/demo", "mjcf", "satellite.xml")  # doctest: +SKIP
    """
    from massprops.api.sources import as_path, mesh_file
    from massprops.errors import InputError
    from massprops.exchange.export import export as write

    if out is None and not isinstance(as_path(source), Path):
        raise InputError("export of a mesh in memory: give out, the file to write")
    with mesh_file(source) as file:
        return write(file, to, _path(out), density, mass, force=force)


@with_options(SimulateOptions, SIMULATE)
def simulate(scenario: Place, out: Place | None = None, **options: Unpack[SimulateOptions]) -> Simulation:
    """Render a body of known mass properties under one sun, or only its tracks, with the truth beside them.

    Args:
        scenario: what to show: spacecraft, asteroid, bracket, tracks, a YAML file or a mesh file.
        out: sequence folder to write.
        frames: number of images.
        size: width and height [px].
        rate: rotation of the body per image [deg].
        fill: greatest length of the body over the image's height.
        phase: angle at the body between camera and Sun [deg].
        distortion: radial distortion of the lens, k1 and k2 as OpenCV's.
        noise: 1-sigma of the darkest pixels [grey levels].
        background: behind the body: black or still.
        stereo: second camera, this far to the right [m].
        range: range sensor with this noise [m].
        hidden_mass: mass that the mesh does not show, its share and place; moves the motion only.
        effects: an effect at work, may be several. "NAME:SIZE" moves the tracks by SIZE [px rms], or
            "NAME:parameter=value,...".
        effect: an effect file of your own; may be several.
        model: what 'diagnose' wrote: its effects act.
        features: feature points, for tracks.
        sigma: 1-sigma of the tracks [px], for tracks.
        outliers: share of wrong tracks, for tracks.
        attitude: an attitude history too, with this noise [rad], for tracks.
        rates: body rates too, with this noise [rad/s], for tracks.
        video: also write cam0/video.mp4 (H.264).
        seed: of motion, Sun, texture and noise.
        force: replace files that this command did not write; never an input.
        progress: told of each frame.

    Raises:
        InputError: an unknown scenario, a value out of range, a mesh that is no closed body, or no place to write.

    Example:
        >>> seen = massprops.simulate("tracks", frames=50, seed=1)
        >>> seen.sequence.tracks.uv.shape[1], len(seen.truth.q)
        (2, 50)
    """
    from massprops.api.results import Kept, Simulation
    from massprops.effect_file import with_effects
    from massprops.simulation.options import changes
    from massprops.simulation.simulate import is_tracks
    from massprops.simulation.simulate import simulate as render

    given = filled(simulate, options)
    wanted = changes(given, is_tracks(str(scenario)))
    progress: Progress | None = given["progress"]
    if progress is not None:
        wanted["progress"] = lambda done, total, what: progress(what, done, total)
    kept = Kept(_path(out))
    with with_effects(_paths(given["effect"])):
        render(str(scenario), kept.folder, given["video"], force=given["force"], **wanted)
    return Simulation(kept)


def campaign(
    configuration: Place | dict[str, Any],
    out: Place | None = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    yes: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Campaign:
    """Run a grid or a random draw of seeded runs into a store that survives, then a table and a report.

    Args:
        configuration: YAML file: kind, parameters, grid, runs. In Python also: its content.
        out: campaign folder; the same command continues a stopped one.
        scheduler: Dask scheduler, as tcp://HOST:8786; default: this machine.
        workers: processes on this machine; default: one per core.
        yes: consent to more than a million runs.
        force: replace files that this command did not write; never an input.
        progress: told of the runs.

    Raises:
        InputError: the configuration is wrong, or the folder belongs to another campaign.
        NotPossible: the cluster or the disk failed on the way; finished runs are kept.

    Example:
        >>> study = {"kind": "drill", "runs": 3}
        >>> massprops.campaign(study, workers=1).column("seed").tolist()
        [0.0, 1.0, 2.0]
    """
    from massprops.campaigns.configuration import plan_of, read_configuration

    plan = plan_of(configuration) if isinstance(configuration, dict) else read_configuration(Path(configuration))
    return _campaign(plan, out, scheduler, workers, yes, force, progress)


def reproduce(
    paper: str,
    case: str | None = None,
    out: Place | None = None,
    *,
    runs: int | None = None,
    seed: int = 0,
    scheduler: str | None = None,
    workers: int | None = None,
    yes: bool = False,
    progress: Progress | None = None,
) -> Campaign:
    """Run a paper's cases; its tables, ours beside the paper's, are in `text`.

    Args:
        paper: for example pesce2017; a wrong name lists them all.
        case: one case; default: all, one after another.
        out: campaign folder to keep; needed to continue a stopped one.
        runs: runs per case; default: the paper's number where it is feasible.
        seed: the first run's seed.
        scheduler: Dask scheduler, as tcp://HOST:8786; default: this machine.
        workers: processes on this machine; default: one per core.
        yes: consent to more than a million runs.
        progress: told of the runs.

    Raises:
        InputError: unknown paper or case, or a number out of range.

    Example:
        >>> print(massprops.reproduce("pesce2017", "C", runs=100).text)  # doctest: +SKIP
    """
    from massprops.campaigns.reproduce import reproduce_plan

    return _campaign(reproduce_plan(paper, case, runs, seed), out, scheduler, workers, yes, False, progress)


@with_options(ArrayOptions, ARRAYS)
def sequence_from_arrays(times: np.ndarray, **options: Unpack[ArrayOptions]) -> Recording:
    """A sequence for `estimate` and `diagnose` from arrays; n epochs, m points.

    Args:
        times: (n,) seconds, increasing.
        tracks: (n, m, 2) pixels of points in one camera, x to the right and y down, not a number where a point is not
            seen; (2, n, m, 2) in a stereo pair.
        camera_matrix: (3, 3) of both cameras [px]; needed with tracks.
        size: width and height of the images [px]; needed with tracks.
        distortion: k1, k2, p1, p2 as OpenCV's.
        baseline: the second camera lies this far to the right of the first [m]; needed with stereo tracks.
        sigma_px: 1-sigma of a track [px].
        attitude: (n, 4) unit quaternions, Hamilton, scalar first, which rotate body vectors into the camera's axes.
        attitude_sigma: 1-sigma of their rotations [rad].
        rates: (n, 3) angular velocity in body axes [rad/s].
        rate_sigma: its 1-sigma [rad/s].
        ranges: (n,) distance from the camera to the centre of mass [m].
        range_sigma: its 1-sigma [m].
        environment: orbit, Sun and magnetic field, as `massprops.sequence.Environment`; not given: the camera moves
            without turning and without acceleration.
        out: a folder to write it into, for the command line; nothing is written when None.

    Raises:
        InputError: shapes that do not fit together, or nothing measured.

    Example:
        >>> import numpy as np
        >>> t = np.linspace(0, 10, 101)
        >>> w = np.stack([0.1 * np.cos(0.2 * t), 0.1 * np.sin(0.2 * t), np.full(101, 0.4)], axis=1)
        >>> record = massprops.sequence_from_arrays(t, rates=w, rate_sigma=1e-4)
        >>> record.rates.w.shape
        (101, 3)
    """
    from massprops.sequence.arrays import Noisy, Pixels, sequence_of

    given = filled(sequence_from_arrays, options)
    pixels = Pixels(**{name: given[name] for name in Pixels.__dataclass_fields__})
    attitude = Noisy(given["attitude"], given["attitude_sigma"])
    rates = Noisy(given["rates"], given["rate_sigma"])
    ranges = Noisy(given["ranges"], given["range_sigma"])
    return sequence_of(times, pixels, attitude, rates, ranges, given["environment"], _path(given["out"]))


def _paths(places: Place | Sequence[Place] | None) -> list[Path]:
    given = [places] if isinstance(places, str | PathLike) else places or []
    return [Path(place) for place in given]


def _path(place: Place | None) -> Path | None:
    return None if place is None else Path(place)


def _campaign(
    plan: Any,
    out: Place | None,
    scheduler: str | None,
    workers: int | None,
    yes: bool,
    force: bool,
    progress: Progress | None,
) -> Campaign:
    from massprops.api.results import Campaign, Kept
    from massprops.campaigns.run import run_campaign

    kept = Kept(_path(out))
    watch = None if progress is None else lambda now: progress("runs", now.done, now.total)
    outcome = run_campaign(plan, kept.folder, scheduler, workers, yes, watch, force)
    rows = [{**p.cell, **row} for p in outcome.points for row in p.dictionaries()]
    return Campaign(outcome.document, rows, kept)
