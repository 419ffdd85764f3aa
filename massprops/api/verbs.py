"""What massprops does, as functions. The command line takes its option names, defaults and help texts from here.

A source is a path, the result of another of these functions, or arrays where the docstring says so. `out` is a folder
for the results; without it, nothing stays on disk. `force` allows replacing files in `out` that massprops did not
write. `progress` is a function that is called as `progress(what, done, total)`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
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
    """Turn a video or photographs of an object into a mesh, its volume, centre of mass and inertia, with intervals.

    Args:
        source: a video, a folder of images, or a sequence folder. If you turned the object over between two takes, give
            one folder or video for each. In Python also: frames in memory in the order they were taken, uint8,
            (n, h, w) grey or (n, h, w, 3) red, green, blue.
        out: folder for the results (the run folder). To continue an interrupted run, give the same command again.
        motion: how it was filmed: 'tumbling' (the body moves, the camera is still), 'static' (the camera moves), or
            'auto' to find out.
        masks: folder of silhouettes named as COLMAP names them (IMAGE.jpg.png); black pixels are not the object.
        object: a pixel on the object, as "X,Y" in the first image used or "FILE:X,Y" in another; can be repeated.
        box: a rectangle around the object, as "X0,Y0,X1,Y1" in the first image used or "FILE:X0,Y0,X1,Y1" in another;
            can be repeated.
        keep_support: count a stand, foam or mat under the object as part of it.
        frames: use at most this many frames per camera.
        max_size: reduce images so that the longer side has at most this many pixels.
        focal: focal length of the source images, if you know it [px].
        mapper: how the camera positions are computed: incremental or global.
        sparse: use this existing COLMAP model instead of computing camera positions.
        dense_views: use at most this many reference views for dense stereo; 0 means automatic.
        density: constant density [kg/m^3]. If not given, 1000 (water) is assumed, and the result says so.
        scale: greatest length of the object, from tip to tip [m]. If no length is known, only ratios can be measured.
        scale_sigma: relative 1-sigma error of the given length; 0.01 is 1 %.
        distance: a known distance: two points, each "x,y,z" in model units or the name of a picked point, and the
            metres between them.
        marker: a printed marker in view: ArUco DICTIONARY:SIDE_METRES, ChArUco DICTIONARY:COLSxROWS:SQUARE_METRES.
        seed: seed of all random draws.
        threads: number of processor threads; 0 means all.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.
        rate_hz: frames per second, for frames in memory.
        progress: called for each stage.

    Returns:
        the run. If the data could not give everything, its `exit_code` is 3 and `reason` says why.

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
        mesh: a closed mesh: STL, OBJ, PLY, GLB or OFF. Small defects are repaired, with a warning. In Python also: a
            `trimesh.Trimesh`.
        out: run folder for the results; it has the same report and exports as that of a reconstruction.
        density: constant density [kg/m^3]. If not given, 1000 (water) is assumed, and the result says so.
        scale: metres per unit of the file; 0.001 if it is in millimetres.
        scale_sigma: relative 1-sigma error of the scale; 0.01 is 1 %.
        force: replace files in the output folder that massprops did not write. The mesh is never replaced.

    Raises:
        InputError: the mesh is not a closed body, or a value is out of range.

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
    """Write a run's silhouettes as image files that you can correct and give back, and a page that shows them.

    Args:
        run: run folder.
        out: folder for the masks and the page. If not given, RUN-masks.
        force: replace masks that you have changed there, and files that massprops did not write.

    Raises:
        InputError: the run has no silhouettes, or the folder holds something else.
    """
    from massprops.api.sources import as_path
    from massprops.run.masks import masks as write_masks

    return write_masks(as_path(run), _path(out), force)


def estimate(
    source: Place | Run | Simulation | Recording,
    out: Place | None = None,
    *,
    more: Sequence[Place | Run | Simulation | Recording] = (),
    method: str | Sequence[str] | None = None,
    prior: Place | Prior | None = None,
    model: Place | None = None,
    effect: Place | Sequence[Place] | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Estimates:
    """Estimate the motion and the inertia ratios from a recording, with several methods.

    Args:
        source: sequence folder or run folder. In Python also: what `sequence_from_arrays` made of your own arrays.
        out: folder for estimates.json, the CSV files and report.html.
        more: further records of the same body: each method's ratios from all of them; estimates.json alone is written.
        method: an estimator: smoother, ekf, iekf, ukf, ukf-gp, range-ukf, momentum-ls or principal-axis-ekf; can be
            repeated. If not given, all that the data allow.
        prior: a file that 'export --to filter' wrote: mass properties to start from.
        model: a model.yaml that 'diagnose' wrote; the smoother uses its effects.
        effect: a file with an effect of your own; can be repeated.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.
        progress: called for each method.

    Raises:
        InputError: a method is unknown, or the recording or the prior cannot be read.
        NotPossible: a method named here needs data that the recording does not have.

    Example:
        >>> seen = massprops.simulate("tracks", frames=120, seed=3)
        >>> found = massprops.estimate(seen, method="momentum-ls")
        >>> found.verdict, abs(found.k1 - seen.truth.facts["k1"]) < 0.02
        ('observable', True)
    """
    from massprops.api.results import Estimates
    from massprops.api.sources import as_path
    from massprops.effect_file import with_effects
    from massprops.estimators.estimate import estimate_all
    from massprops.estimators.several import estimate_several
    from massprops.report.estimates import write_estimates, write_together

    records, methods, tell = [as_path(s) for s in (source, *more)], _methods(method), _told(progress)
    others = tuple(Path(p) for p in (prior, model) if isinstance(p, str | PathLike))
    write: Callable[[Path], Path]
    with with_effects(_paths(effect)):
        if more:
            document, outcome = estimate_several(records, methods, prior, model, tell)  # type: ignore[arg-type]
            inputs = tuple(p for p in (*records, *others) if isinstance(p, Path))
            write = partial(write_together, document, inputs=inputs, force=force)
        else:
            outcome = estimate_all(records[0], methods, prior, tell, model)  # type: ignore[arg-type]
            write = partial(write_estimates, outcome, source=records[0], more=others, force=force)
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
    """Test whether mesh and motion agree on inertia ratios and principal axes; writes `crosscheck.json` into the run.

    Args:
        run: run folder of `reconstruct`.
        sequence: use this sequence of the same footage instead of the run's own.
        method: an estimator; can be repeated. If not given, all that the data allow.
        force: replace files in the run folder that massprops did not write. Inputs are never replaced.
        progress: called for each estimator.

    Raises:
        InputError: the run has no mass properties, or a sequence cannot be read.

    Example:
        >>> massprops.crosscheck("runs/demo").verdict  # doctest: +SKIP
        'consistent'
    """
    from massprops.api.sources import as_path
    from massprops.consistency.crosscheck import crosscheck as check

    return check(as_path(run), as_path(sequence), _methods(method), progress=_told(progress), force=force)


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
    """Find where a recorded motion departs from that of a free rigid body, and name the effect that is missing.

    Args:
        source: sequence folder or run folder. In Python also: what `sequence_from_arrays` made of your own arrays.
        out: folder for diagnosis.json, model.yaml, residual.csv and report.html.
        more: further records of the same body; they share its inertia, a wheel's moment and other parameters of the body.
        discover: if no known effect fits, search for a formula; writes law.py and law.yaml.
        simulator: your own simulator, as 'module:function' or 'FILE.py:function'; it is fitted to the record.
        effect: a file with an effect of your own; can be repeated.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.
        progress: called for each step.

    Raises:
        InputError: the recording cannot be read, or a body file contradicts itself.
        NotPossible: nothing in the recording shows how the body moves, or it is no free flight, or a sensor is at fault.

    Example:
        >>> seen = massprops.simulate("tracks", effects=["viscous-damping:6"])  # doctest: +SKIP
        >>> massprops.diagnose(seen).effects  # doctest: +SKIP
        {'viscous-damping': {'rate': 0.00021}}
    """
    from massprops.api.results import Diagnosis
    from massprops.api.sources import as_path
    from massprops.diagnosis.search.diagnose import diagnose as search
    from massprops.diagnosis.search.diagnose import write_found
    from massprops.diagnosis.several import ONE_RECORD
    from massprops.effect_file import with_effects
    from massprops.errors import InputError

    given = as_path(source)
    if more:
        if discover or simulator is not None:
            raise InputError(ONE_RECORD)
        with with_effects(_paths(effect)):
            return _several([given, *map(as_path, more)], _path(out), force, progress)
    inputs = [given] if isinstance(given, Path) else []
    with with_effects(_paths(effect)):
        result = search(
            given,
            _path(out),
            **({} if progress is None else {"progress": progress}),
            force=force,
            discover=discover,
            simulator=simulator,
        )
    folder = _path(out)
    return Diagnosis(result.document, result.model, folder, lambda place: write_found(place, result, inputs, force))


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


def open_run(folder: Place) -> Run:
    """Open a run that was made earlier, for its results.

    Args:
        folder: run folder of `reconstruct`, or of `mass_properties` with `out`.

    Raises:
        InputError: no run in that folder.

    Example:
        >>> massprops.open_run("runs/demo").volume  # doctest: +SKIP
        1.819
    """
    from massprops.errors import InputError
    from massprops.report.data import read_json
    from massprops.run.reconstruct import Run

    run = Path(folder)
    if not (run / "massprops.json").is_file() and not (run / "report.json").is_file():
        raise InputError(f"{run}: no run in this folder; give one that 'massprops reconstruct' made")
    ended = read_json(run / "report.json")
    result = Run(run, int(ended.get("exit_code") or 0), str(ended.get("reason") or ""))
    if (run / "massprops.json").is_file():
        result.warnings.extend(result.properties.get("warnings") or ())
    return result


def compare(
    source: Place | Run | Solid | trimesh.Trimesh,
    cad: Place | trimesh.Trimesh,
    out: Place | None = None,
    *,
    free_scale: bool | None = None,
    cad_unit: str = "auto",
    force: bool = False,
) -> Comparison:
    """Align a result with a CAD mesh, then measure the distances between the surfaces and the error of every quantity.

    Args:
        source: run folder, or mesh file in metres. In Python also: a `trimesh.Trimesh`.
        cad: a closed mesh: STL, OBJ, PLY, GLB or OFF. In Python also: a `trimesh.Trimesh`.
        out: folder for compare.json and the coloured mesh. Give the run folder to see them in its report.
        free_scale: fit the scale as well. If not given, it is fitted only when the run has none.
        cad_unit: unit of the CAD file: m, cm, mm, in, or auto.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.

    Raises:
        InputError: a file is missing or is not a closed body, or `out` cannot be written.

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
    """Write mass properties, or a run's cameras, in the format of another program.

    Args:
        source: run folder, or mesh file in metres. In Python also: a `trimesh.Trimesh` in metres.
        to: the format: filter, urdf, mjcf, sdf, usd, basilisk, csv, json, colmap-text, nerfstudio, tum, rerun.
        out: file to write. If not given, a file in the run folder or beside the mesh file. In Python a mesh in memory
            needs it.
        density: density of a mesh file [kg/m^3]. If not given, 1000 (water) is assumed, and the result says so.
        mass: measured mass [kg]; the inertia is scaled to it.
        force: replace a file that massprops did not write. Inputs are never replaced.

    Returns:
        the file written.

    Raises:
        InputError: the format is unknown, there is no mesh, the body is impossible, or metres are needed and no length
            was given.

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
    """Make test data with known truth: images of a tumbling body, or only the tracks of its points.

    Args:
        scenario: what to simulate: spacecraft, asteroid, bracket, tracks, a YAML file or a mesh file.
        out: sequence folder for the data and the truth.
        frames: number of images.
        size: width and height of the images [px].
        rate: how far the body turns from one image to the next [deg].
        fill: greatest length of the body divided by the height of the image.
        phase: angle at the body between camera and Sun [deg].
        distortion: radial distortion of the lens, k1 and k2 as in OpenCV.
        noise: 1-sigma noise of the darkest pixels [grey levels].
        background: what is behind the body: black or still.
        stereo: add a second camera this far to the right [m].
        range: add a range sensor with this 1-sigma noise [m].
        hidden_mass: mass inside the body that the mesh does not show, as share and position; only the motion shows it.
        effects: an effect that acts; can be repeated. "NAME:SIZE" makes it move the tracks by SIZE [px rms];
            "NAME:parameter=value,..." sets its parameters.
        effect: a file with an effect of your own; can be repeated.
        model: a model.yaml that 'diagnose' wrote; its effects act.
        features: number of feature points (only for tracks).
        sigma: 1-sigma noise of the tracks [px] (only for tracks).
        outliers: share of wrong tracks (only for tracks).
        attitude: add measured attitudes with this 1-sigma noise [rad] (only for tracks).
        rates: add measured body rates with this 1-sigma noise [rad/s] (only for tracks).
        video: also write cam0/video.mp4 (H.264).
        seed: seed of the motion, Sun direction, texture and noise.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.
        progress: called for each frame.

    Raises:
        InputError: the scenario is unknown, a value is out of range, a mesh is not a closed body, or `out` cannot be
            written.

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
    wanted = changes(given, is_tracks(str(scenario))) | {"progress": _told(given["progress"])}
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
    """Run many seeded cases, from a grid or drawn at random, and summarise them in a table and a report.

    Args:
        configuration: YAML file with kind, parameters, grid and runs. In Python also: the same as a dict.
        out: campaign folder. To continue a stopped campaign, or to add runs, give the same folder again.
        scheduler: address of a Dask scheduler, for example tcp://HOST:8786. If not given, this machine does the work.
        workers: number of processes on this machine. If not given, one per core.
        yes: agree to more than a million runs.
        force: replace files in the output folder that massprops did not write. Inputs are never replaced.
        progress: called as runs finish.

    Raises:
        InputError: the configuration is wrong, or the folder belongs to another campaign.
        NotPossible: the cluster or the disk failed; finished runs are kept.

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
    """Run the cases of a paper. The tables, our numbers beside the paper's, are in `text`.

    Args:
        paper: one of feng2018, hu2024, kabir2025, pesce2017, volpe2017; or smoother, a test against the Cramér-Rao bound.
        case: one case of the paper. If not given, all of them, one after another.
        out: folder to keep the runs in; without it an interrupted run cannot be continued.
        runs: runs per case. If not given, the paper's number where that is feasible.
        seed: seed of the first run.
        scheduler: address of a Dask scheduler, for example tcp://HOST:8786. If not given, this machine does the work.
        workers: number of processes on this machine. If not given, one per core.
        yes: agree to more than a million runs.
        progress: called as runs finish.

    Raises:
        InputError: the paper or the case is unknown, or a number is out of range.

    Example:
        >>> print(massprops.reproduce("pesce2017", "C", runs=100).text)  # doctest: +SKIP
    """
    from massprops.campaigns.reproduce import reproduce_plan

    return _campaign(reproduce_plan(paper, case, runs, seed), out, scheduler, workers, yes, False, progress)


@with_options(ArrayOptions, ARRAYS)
def sequence_from_arrays(times: np.ndarray, **options: Unpack[ArrayOptions]) -> Recording:
    """Make a recording for `estimate` and `diagnose` from your own arrays of n epochs and m points.

    Args:
        times: (n,) seconds, increasing.
        tracks: (n, m, 2) pixels of points in one camera, x to the right and y down, NaN where a point is not seen;
            (2, n, m, 2) for a stereo pair.
        camera_matrix: (3, 3) of both cameras [px]; needed with tracks.
        size: width and height of the images [px]; needed with tracks.
        distortion: k1, k2, p1, p2 as in OpenCV.
        baseline: how far the second camera is to the right of the first [m]; needed with stereo tracks.
        sigma_px: 1-sigma noise of a track [px].
        attitude: (n, 4) unit quaternions, Hamilton, scalar first, which rotate body vectors into the camera's axes.
        attitude_sigma: 1-sigma noise of the attitudes [rad].
        rates: (n, 3) angular velocity in body axes [rad/s].
        rate_sigma: 1-sigma noise of the rates [rad/s].
        ranges: (n,) distance from the camera to the centre of mass [m].
        range_sigma: 1-sigma noise of the ranges [m].
        environment: orbit, Sun and magnetic field, as `massprops.sequence.Environment`. If not given, the camera
            neither turns nor accelerates.
        out: folder to write the recording into, for use by the command line. If None, nothing is written.

    Raises:
        InputError: the shapes do not fit together, or nothing was measured.

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


def _methods(named: str | Sequence[str] | None) -> list[str]:
    return [named] if isinstance(named, str) else list(named or ["all"])


def _told(progress: Progress | None) -> Callable[[int, int, str], None]:
    """`progress` as the package calls it."""
    from massprops.core.progress import silent

    return silent if progress is None else lambda done, total, what: progress(what, done, total)


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
