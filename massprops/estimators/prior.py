"""A prior from a file: read, checked, turned into the estimators' body frame, and judged by the data before its use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.dynamics.alignment import similarity
from massprops.dynamics.inertia import is_physical, ratios
from massprops.errors import InputError
from massprops.estimators.result import Prior
from massprops.estimators.start import Start
from massprops.mass.ratio_space import chi_square, covariance, inertia_of, log_components, p_value, turn_jacobian

if TYPE_CHECKING:
    from massprops.documents.filter import FeaturesFile, FilterFile
    from massprops.estimators.result import Estimate
    from massprops.model.problem import Problem

REJECT_BELOW = 1e-3
"""A prior that the data would contradict so by chance less often than this is left out."""
AXES_UNKNOWN = 1.0
"""1-sigma [rad] of axes that the data of the sequence do not tie to those of the prior."""


@dataclass(frozen=True)
class FilterPrior:
    """A prior with what ties its frame to footage.

    Attributes:
        prior: in the frame of the file.
        k_covariance: (2, 2) of k1, k2; axes_covariance: (3, 3) of small turns about the principal axes [rad^2].
        mark_ns: (f,) timestamps and mark_q: (f, 4) attitudes of the footage whose attitude0 frame the file is in.
        metric: features are in metres, not in model units.
        source: where it came from.
    """

    prior: Prior
    k_covariance: np.ndarray | None = None
    axes_covariance: np.ndarray | None = None
    mark_ns: np.ndarray | None = None
    mark_q: np.ndarray | None = None
    metric: bool = True
    source: str = ""


@dataclass(frozen=True)
class PriorTest:
    """What the data say of a prior.

    Attributes:
        verdict: `used`, `rejected` (contradicted and left out) or `unchecked` (nothing to hold it against).
        prior: what the estimators are given, in their frame; its inertia is None when rejected.
        chi2, degrees, p_value: of the prior against the reference, None when unchecked.
        frame: how the frames were tied: `attitude0`, `features` or `none`.
        reference: name of the estimator that judged.
        warnings: one line each.
    """

    verdict: str
    prior: Prior
    chi2: float | None = None
    degrees: int = 0
    p_value: float | None = None
    frame: str = "none"
    reference: str = ""
    warnings: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """For `estimates.json`."""
        return {k: getattr(self, k) for k in ("verdict", "chi2", "degrees", "p_value", "frame", "reference")}


def read_filter(path: str | Path) -> FilterPrior:
    """The prior of a filter file, in that file's frame, with the covariances and the frame's mark.

    Raises:
        InputError: no such file, not a filter file, or numbers that no body has.
    """
    from massprops.documents.fields import read
    from massprops.documents.filter import FORMAT, FilterFile
    from massprops.documents.loading import excerpt, load_yaml

    path = Path(path)
    if not path.is_file():
        raise InputError(f"--prior {path}: no such file; massprops export RUN --to filter writes one")
    content = load_yaml(path)
    if content.get("format", FORMAT) != FORMAT:
        given_format = excerpt(content["format"])
        raise InputError(
            f"{path}: its format is {given_format}, not {FORMAT!r}: write it with 'massprops export RUN --to filter'"
        )
    document = read(FilterFile, content, str(path))
    inertia = _inertia(path, document)
    k_cov = _covariance(path, "k_covariance", document.k_covariance)
    axes_cov = _covariance(path, "axes_covariance_rad2", document.axes_covariance_rad2)
    ids, points = _features(path, document.features)
    mark = document.frame.mark if document.frame is not None and document.frame.mark else None
    prior = Prior(
        inertia=inertia,
        k_sigma=None if k_cov is None else np.sqrt(np.diag(k_cov)),
        axes_sigma=None if axes_cov is None else np.sqrt(np.diag(axes_cov)),
        features=points,
        feature_ids=ids,
        feature_sigma=None if points is None or document.features is None else document.features.sigma,
        process_noise=document.process_noise,
    )
    if inertia is None and points is None and document.process_noise is None:
        raise InputError(f"{path}: says nothing of the body: give inertia, or k1 and k2, or features")
    # the marks' timestamps are taken from the text: as floats they would lose their last digits
    return FilterPrior(
        prior,
        k_cov,
        axes_cov,
        None if mark is None else np.array([int(row[0]) for row in content["frame"]["mark"]], np.int64),
        None if mark is None else np.array([row[1:] for row in mark]),
        document.features is None or document.features.units == "m",
        document.source or str(path),
    )


def _inertia(path: Path, document: FilterFile) -> np.ndarray | None:
    axes = np.eye(3)
    if document.principal_axes is not None:
        axes = document.principal_axes
        if not np.allclose(axes.T @ axes, np.eye(3), atol=1e-3):
            raise InputError(f"{path}: principal_axes must be three unit columns at right angles")
        axes = np.linalg.svd(axes)[0] @ np.linalg.svd(axes)[2]
    k = None
    if document.inertia_ratios is not None:
        k = np.array([document.inertia_ratios.k1, document.inertia_ratios.k2])
    if document.inertia is None:
        if k is None:
            return None
        inertia = inertia_of(np.minimum(k, 0.0), axes)
    else:
        inertia = document.inertia
        if not np.allclose(inertia, inertia.T, rtol=1e-6, atol=1e-9 * float(np.abs(inertia).max())):
            raise InputError(f"{path}: inertia is not symmetric: make I_xy = I_yx, I_xz = I_zx, I_yz = I_zy")
    inertia = 0.5 * (inertia + inertia.T)
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0:
        raise InputError(f"{path}: inertia has a principal moment of {moments[0]:.4g}; all three must be above 0")
    if not is_physical(moments, 1e-6):
        moments_text = ", ".join(f"{m:.4g}" for m in moments / moments.sum())
        raise InputError(
            f"{path}: principal moments in the ratio {moments_text} break the triangle inequality: correct inertia"
        )
    if k is not None and not np.allclose(ratios(inertia)[0], k, atol=1e-3):
        from_inertia = ratios(inertia)[0]
        raise InputError(
            f"{path}: inertia gives k1 = {from_inertia[0]:.4f}, k2 = {from_inertia[1]:.4f}, but inertia_ratios says "
            f"{k[0]:.4f}, {k[1]:.4f}: correct one of them"
        )
    return inertia / np.trace(inertia)


def _covariance(path: Path, key: str, matrix: np.ndarray | None) -> np.ndarray | None:
    if matrix is None:
        return None
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12 * float(np.abs(matrix).max() or 1.0)):
        raise InputError(f"{path}: {key} is not symmetric: make it equal to its transpose")
    matrix = 0.5 * (matrix + matrix.T)
    if np.linalg.eigvalsh(matrix)[0] < -1e-9 * max(float(np.trace(matrix)), 0.0) or (np.diag(matrix) <= 0).any():
        raise InputError(f"{path}: {key} is not a covariance: its variances must be above 0")
    return matrix


def _features(path: Path, content: FeaturesFile | None) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Numbers (m,) and places (m, 3); None without any."""
    if content is None or not content.ids:
        return None, None
    ids = np.array(content.ids, np.int64)
    if len(np.unique(ids)) != len(ids):
        raise InputError(f"{path}: features: ids must be a list of different whole numbers")
    if content.xyz is None or len(content.xyz) != len(ids):
        raise InputError(f"{path}: features: xyz must have one row of 3 numbers for each of the {len(ids)} ids")
    return ids, content.xyz


def judge(given: FilterPrior, reference: Estimate | None, start: Start, problem: Problem) -> PriorTest:
    """Turns a prior into the start's frame and holds it against an estimate made without it.

    Args:
        given: the prior.
        reference: an estimate that knows nothing of it, or None.
        start: of the same problem, without the prior.
        problem: the measurements.
    """
    prior, frame = into_frame(given, start, reference, problem)
    if prior.inertia is None:
        return PriorTest("used", prior, frame=frame)
    sound = reference is not None and reference.converged and reference.observable
    if not sound or reference is None or reference.inertia is None or reference.k_covariance is None:
        why = "no estimate without it can be trusted, so nothing tests it"
        return PriorTest("unchecked", prior, frame=frame, warnings=(f"the prior was used unchecked: {why}",))
    k_cov = np.diag(np.square(prior.k_sigma)) if prior.k_sigma is not None else np.zeros((2, 2))
    if given.k_covariance is not None:
        k_cov = given.k_covariance
    k, axes = ratios(prior.inertia)
    difference = log_components(reference.inertia, axes) - log_components(prior.inertia, axes)
    spread = covariance(reference.inertia, _inflated(reference), reference.axes_covariance, axes)
    spread[:2, :2] += k_cov
    both = frame != "none" and reference.axes_covariance is not None and given.axes_covariance is not None
    if both:
        # the file's turns are about the principal axes, the Jacobian's about body axes
        by_turn = turn_jacobian(prior.inertia, axes) @ axes
        spread += by_turn @ given.axes_covariance @ by_turn.T
        chi2, degrees = chi_square(difference, spread)
    else:
        apart = np.array([reference.k1, reference.k2]) - k
        chi2, degrees = chi_square(apart, _inflated(reference) + k_cov)
    p = p_value(chi2, degrees)
    test = PriorTest("used", prior, chi2, degrees, p, frame, reference.name)
    if p >= REJECT_BELOW:
        return test
    line = (
        f"the data contradict the prior (k1 = {k[0]:.4f}, k2 = {k[1]:.4f} against {reference.k1:.4f}, "
        f"{reference.k2:.4f} from {reference.name} without it; chi-square {chi2:.1f} of {degrees}, p = {p:.1g}), so its "
        "inertia and features are left out; check that it is of this body"
    )
    bare = Prior(process_noise=prior.process_noise)
    return replace(test, verdict="rejected", prior=bare, warnings=(line,))


def _inflated(estimate: Estimate) -> np.ndarray:
    """Covariance of k; residuals that are larger than their noise widen it."""
    assert estimate.k_covariance is not None
    return estimate.k_covariance * max(1.0, estimate.innovation or 1.0)


def into_frame(given: FilterPrior, start: Start, reference: Estimate | None, problem: Problem) -> tuple[Prior, str]:
    """The prior in the estimators' body frame, and what tied the frames: `attitude0`, `features` or `none`."""
    prior = given.prior
    if getattr(start, "body_frame", "own") == "attitude0" and _same_footage(given, problem):
        return replace(prior if given.metric else _in_metres(prior, start, problem), attitude=True), "attitude0"
    common = _common(prior, problem, getattr(start, "features", None))
    if (
        common is None
        and reference is not None
        and reference.features is not None
        and reference.feature_ids is not None
    ):
        common = _common(prior, replace(problem, features=reference.feature_ids), reference.features)
    if common is not None:
        scale, R = common
        turned = None if prior.inertia is None else R @ prior.inertia @ R.T
        points = None if prior.features is None else scale * prior.features @ R.T
        sigma = None if prior.feature_sigma is None else scale * prior.feature_sigma
        return replace(prior, inertia=turned, features=points, feature_sigma=sigma, attitude=True), "features"
    # the ratios stand without the axes
    inertia = prior.inertia
    known = getattr(start, "inertia", None)
    if reference is not None and reference.inertia is not None:
        known = reference.inertia
    if inertia is not None and known is not None:
        inertia = inertia_of(ratios(inertia)[0], ratios(known)[1])
    unknown = np.full(3, AXES_UNKNOWN)
    alone = replace(prior, inertia=inertia, axes_sigma=unknown, features=None, feature_ids=None, attitude=False)
    return alone, "none"


def _same_footage(given: FilterPrior, problem: Problem) -> bool:
    if given.mark_ns is None or given.mark_q is None or not len(given.mark_ns):
        return False
    at = np.searchsorted(problem.stamp_ns, given.mark_ns)
    at = np.minimum(at, len(problem.stamp_ns) - 1)
    same = problem.stamp_ns[at] == given.mark_ns
    cosine = np.abs(np.einsum("ij,ij->i", np.nan_to_num(problem.attitude[at]), given.mark_q))
    return bool(same.all() and (cosine > 1 - 1e-6).all())


def _in_metres(prior: Prior, start: Start, problem: Problem) -> Prior:
    """Features in model units, in the scale of the start; left out where that cannot be told."""
    common = _common(prior, problem, getattr(start, "features", None))
    if common is None or prior.features is None:
        return replace(prior, features=None, feature_ids=None, feature_sigma=None)
    sigma = None if prior.feature_sigma is None else common[0] * prior.feature_sigma
    return replace(prior, features=common[0] * prior.features, feature_sigma=sigma)


def _common(prior: Prior, problem: Problem, features: np.ndarray | None) -> tuple[float, np.ndarray] | None:
    """Scale and rotation that lay the prior's features on the sequence's of the same numbers, when they are the same."""
    if prior.features is None or prior.feature_ids is None or features is None:
        return None
    _, a, b = np.intersect1d(prior.feature_ids, problem.features, return_indices=True)
    if len(a) < 4 or len(features) != len(problem.features):
        return None
    good = np.isfinite(features[b]).all(axis=1)
    if good.sum() < 4:
        return None
    return similarity(prior.features[a[good]], features[b[good]])
