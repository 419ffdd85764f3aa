"""What a run folder contains, and the main keys of the JSON results; a test compares them with real results."""

from __future__ import annotations

RUN = {
    "report.html": "the report, one page that opens offline",
    "massprops.json": "the mass properties; see [below](#masspropsjson)",
    "report.json": "`exit_code`, and if it is not 0 the `reason` and the `stage`",
    "crosscheck.json": "shape against motion",
    "compare.json, compare.ply, compare_legend.png": "after `massprops compare RUN CAD -o RUN`: the numbers, the mesh in "
    "colours of its distance to the CAD mesh, and their legend",
    "mesh.ply": "the mesh with the colours of the photographs; `origin` of each face: 0 filled in, 1 measured, 2 closed at "
    "the support",
    "mesh.glb": "the same mesh, for viewers",
    "cloud.ply": "the points that stereo measured",
    "masks/": (
        "the silhouettes, `NAME.png` for the frame NAME; of an object on a table drawn from the mesh and refined by the images"
    ),
    "sparse/": "cameras and points as a COLMAP model, in the units of `massprops.json`",
    "sequence/": "tracks and attitudes as a [sequence](sequence.md), if the object moved",
    "run.yaml": "options, hashes of the inputs, versions, time and memory of every stage",
    "work/": "intermediate results, from which an interrupted run continues",
    ".massprops/": "the record of which files massprops wrote, and `previous/` with replaced results",
}

RESULTS = {
    "crosscheck.json": {
        "verdict": "`consistent`, `inconsistent` or `unobservable`",
        "reason": "one sentence",
        "p_value": "probability of such a difference, or a larger one, if mesh and motion describe the same body",
        "tests": "the same for single quantities",
        "mesh": "`k1`, `k2`, `principal_axes` (unit columns), `center_of_mass` of the mesh, with sigmas",
        "estimators": "the same from each estimator, and by how many degrees its axes differ; `film` is the adjustment of a film whose "
        "images were placed by one free motion",
        "rests_on": "the estimator that decides the verdict: `film` where there is one, else the smoother",
        "skipped": "estimators that could not run, with the reason",
        "hints": "possible explanations of a contradiction, the likeliest first",
        "fused": "mass properties from mesh and motion together, or `null`",
        "centre_of_motion": "the point about which the body turns, in the axes of the mesh",
        "residuals": "attitude residuals over time, with each inertia [deg]",
    },
    "compare.json": {
        "rows": "one entry per quantity: `cad`, `ours`, `error`, `relative_error`, `unit`, `interval_90`, `holds`",
        "fused": "the same for mesh and motion together, or `null`",
        "recommended": "which of the two the run recommends: `mesh` or `fused`",
        "distances": "between the surfaces in both directions [m]: median, signed mean, rms, 95 %, Hausdorff",
        "transform": "4 x 4 matrix from the axes of the run to those of the CAD mesh",
        "scale": "the factor in that matrix",
        "free_scale": "whether that factor was fitted",
        "colour_limit": "distance at which the colours of `compare.ply` end [m]",
        "units": "`length` and `mass`",
        "frame": "the axes of the numbers, in words",
        "warnings": "one sentence each",
    },
    "estimates.json": {
        "estimators": "one entry per method: `k1`, `k2`, `sigma_k1`, `sigma_k2`, `inertia` (trace 1), `principal_axes` (unit "
        "columns), `rate`, `observable`, `reliable`, `because`, `history` (its CSV file); of several records `p_value`, the chance that they are of one body, and `parameters` and `sigma` of what else the body has, by effect",
        "skipped": "methods that could not run, with the reason",
        "reason": "why no method gives the ratios, or empty",
        "prior": "the verdict on the prior, or `null`",
        "measured": "how many tracks, attitudes, ranges and rates there are",
        "epochs": "number of moments",
        "seconds": "length of the recording",
        "source": "what was read",
        "warnings": "one sentence each",
    },
    "diagnosis.json": {
        "verdict": "`none`, `named`, `ambiguous` or `unexplained`",
        "reason": "one sentence",
        "effects": "each effect named: `parameters` (null where the data do not show one), `sigma`, `units`, `delta_bic` (by how "
        "much the Bayesian information criterion falls; large is good), `held_out_gain` (by how much the residuals of data that no fit has seen fall)",
        "candidates": "each effect that was tried, with the same scores",
        "gap": "residuals divided by the noise, `before` and `after`, for the `fitted` and the `held_out` data; from attitudes or "
        "rates also with an unknown torque beside what is named, or alone where nothing is (`beside_unknown`)",
        "where": "where and when the residuals are largest: `channel`, `interval_s`, `features`, `z` (how far beyond chance, in "
        "standard deviations), `size` (rms over the noise)",
        "latent": "only from attitudes or rates: the torque that the motion shows without a model, how likely it is "
        "(`evidence`), its size and 1-sigma as the report shows it (`shown_rms`, `shown_sigma`), and what it goes along with (`correlates`)",
        "lever": "only with an accelerometer: from the centre of mass to the sensor, with its 1-sigma, and what it does not explain",
        "simulator": "only with `--simulator`: its parameters (null where the data do not show one) with sigmas, and what it leaves",
        "law": "only with `--discover`: the formula that was found, with its terms, what is equal to each in this record "
        "(`same_here`), other laws that are nearly as likely (`rivals`), and its log evidence over what is named (`catalogue`)",
        "momentum": "only from tracks: by how much angular momentum and energy drift and scatter",
        "skipped": "effects that were not tried, with the reason",
        "corrected": "`k1`, `k2` and the rate, before and after",
        "axes": "the body axes of the numbers, in words",
        "shared": "only of several records: ratios, turns of the principal axes (`axis_turn_1` to `3`, rad, from the common ones) and the body's parameters as each record tells them (`values`, `sigma`, null where it does not), and the chance of values so far apart (`p_value`)",
        "turned": "only of several records: where the sensors' axes turn in the body from record to record, the turn of each (`record`) from the first's: `turn_rad`, a rotation vector in body axes, and `sigma`; else empty. All that is common is then told in the first record's axes",
        "agreement": "only of several records: by how much their log evidence rises if they share a body",
        "records": "only of several records: the diagnosis of each by itself",
        "model": "the file with the model that includes the effects",
        "warnings": "one sentence each",
    },
}


def text() -> str:
    """The two sections, as Markdown."""
    lines = ["## Files of a run\n", "| file | content |", "|---|---|"]
    lines += [f"| {', '.join(f'`{n}`' for n in names.split(', '))} | {about} |" for names, about in RUN.items()]
    lines.append("\n## JSON results\n")
    lines.append(
        "Every file has `format`, its kind and version. Numbers are in SI units unless the name has another one."
    )
    for name, keys in RESULTS.items():
        lines += [f"\n### `{name}`\n", "| key | meaning |", "|---|---|"]
        lines += [f"| `{key}` | {about} |" for key, about in keys.items()]
    return "\n".join(lines)
