"""The law of a sequence: from whatever it measures to a record of the balance, and the files that a law leaves."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.diagnosis.discovery.law import Law, discover, document_of_law, model_of_law
from massprops.diagnosis.record import Record, record_of_attitudes, record_of_rates
from massprops.errors import NotPossible
from massprops.sequence.data import AttitudeSeries, Sequence

LAW_FILES = ("law.py", "law.yaml")
"""Beside the files of a diagnosis: the effect, and the model with its parameters."""


def record_of_sequence(sequence: Sequence) -> Record:
    """The record of attitudes where there are some, from stereo tracks too, else of body rates.

    Raises:
        NotPossible: nothing shows the rotation, or too little of it.
    """
    if sequence.attitude is not None and len(sequence.attitude.q):
        return record_of_attitudes(sequence.attitude, sequence.environment)
    if sequence.tracks is not None and len(sequence.tracks.feature):
        return record_of_attitudes(_attitudes_of_tracks(sequence), sequence.environment)
    if sequence.rates is not None and len(sequence.rates.w):
        return record_of_rates(sequence.rates)
    raise NotPossible("--discover: the sequence holds no attitudes, no body rates and no stereo tracks")


def law_of_sequence(sequence: Sequence) -> Law | None:
    """The law that a sequence asks for, or None.

    Raises:
        NotPossible: nothing shows the rotation, or the fits lead nowhere.
    """
    from massprops.diagnosis.selection import without_effects

    record = record_of_sequence(sequence)
    base, unknown = without_effects(record)
    return None if unknown is base else discover(record, base, unknown)


def files_of_law(law: Law | None) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """What `diagnosis.json` says of a law, and its files by name."""
    import yaml

    from massprops.core.files import plain

    document = document_of_law(law)
    if law is None:
        return document, {}
    model = yaml.safe_dump(plain(model_of_law(law)), sort_keys=False, allow_unicode=True)
    return document, {"law.py": law.source, "law.yaml": model}


def _attitudes_of_tracks(sequence: Sequence) -> AttitudeSeries:
    """Attitudes as each epoch of stereo tracks alone shows them."""
    from massprops.estimators.problem import problem_of
    from massprops.estimators.result import Prior
    from massprops.estimators.start import first_guess

    problem = problem_of(sequence)
    if not problem.stereo:
        raise NotPossible(
            "--discover: one camera shows attitudes only after 'massprops reconstruct': give its run folder"
        )
    poses = first_guess(problem, Prior()).poses
    if poses is None:
        raise NotPossible("--discover: the tracks show no attitudes")
    return AttitudeSeries(problem.stamp_ns[poses.rows], poses.q, np.asarray(poses.sigma))
