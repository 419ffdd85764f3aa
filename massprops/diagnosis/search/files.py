"""What a diagnosis leaves on disk: `diagnosis.json`, `model.yaml`, `residual.csv`, `report.html`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from massprops.core.files import json_text, plain
from massprops.core.inputs import key_of_source
from massprops.core.outputs import deliver
from massprops.diagnosis.residual_rows import HEAD, torque_rows
from massprops.diagnosis.search.result import Diagnosis
from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements


def write_diagnosis(
    out: Path,
    d: Diagnosis,
    inputs: Iterable[Path] = (),
    force: bool = False,
) -> Path:
    """Writes everything, all of it or nothing.

    Args:
        out: folder; made when it is not there.
        d: what was found.
        inputs: what it was found in.
        force: files in the folder that no `diagnose` wrote may be replaced.

    Raises:
        InputError: the folder holds somebody's files, or cannot be written.
    """
    import yaml

    from massprops.diagnosis.search.report import page

    contents: dict[str, str | bytes] = {
        "residual.csv": _residual_table(d),
        "model.yaml": yaml.safe_dump(plain(d.model), sort_keys=False, allow_unicode=True),
        "diagnosis.json": json_text(d.document),
        "report.html": page(d),
    }
    return write_contents(out, {**contents, **d.law}, inputs, force)


def write_contents(out: Path, contents: dict[str, str | bytes], inputs: Iterable[Path], force: bool) -> Path:
    """The files of a diagnosis, all of them or none; see `write_diagnosis`."""
    given = list(inputs)
    deliver(out, "diagnose", contents, key_of_source(*given) if given else None, given, force)
    return out


def _residual_table(d: Diagnosis) -> str:
    """Residuals before and after by measurement, and the torque recovered without a model where there is one, with its 1-sigma."""
    base = d.selection.base
    best = d.selection.best or base
    problem, m = d.case.problem, d.case.fitted
    lines = [HEAD]
    stamp = problem.stamp_ns

    def rows(channel: str, at: np.ndarray, before: np.ndarray, after: np.ndarray, names: str) -> None:
        for i, t in enumerate(stamp[at]):
            for k, name in enumerate(names):
                lines.append(f"{t},{channel},,,{name},{before[i, k]:.4f},{after[i, k]:.4f}")

    b, a = base.fit.residuals, best.fit.residuals
    _tracks(lines, stamp, problem.features, m, b, a)
    rows("range", m.range_at, b.range[:, None], a.range[:, None], "r")
    rows("rate", m.rate_at, b.rates, a.rates, "xyz")
    rows("attitude", m.attitude_at, b.attitude, a.attitude, "xyz")
    if d.torque is not None:
        stamps = [problem.first_ns + int(t * 1e9) for t in d.torque["times"]]
        lines += torque_rows(stamps, d.torque["torque"], d.torque["sigma"])
    return "\n".join(lines) + "\n"


def _tracks(
    lines: list[str], stamp: np.ndarray, features: np.ndarray, m: Measurements, before: Residuals, after: Residuals
) -> None:
    for i in range(len(m.uv)):
        head = f"{stamp[m.seen.epoch[i]]},tracks,{m.seen.camera[i]},{features[m.seen.feature[i]]}"
        for k, name in enumerate("uv"):
            lines.append(f"{head},{name},{before.tracks[i, k]:.4f},{after.tracks[i, k]:.4f}")
