"""From whatever a sequence measures to the record that the balance of momentum takes."""

from __future__ import annotations

import numpy as np

from massprops.diagnosis.record import Record, record_of_attitudes, record_of_rates
from massprops.errors import NotPossible
from massprops.sequence.data import AttitudeSeries, Sequence


def record_of_sequence(sequence: Sequence) -> Record:
    """The record of attitudes where there are some, from stereo tracks too, else of body rates. Times count from the first of all
    that was measured.

    Raises:
        NotPossible: nothing shows the rotation, or too little of it.
    """
    given, first = sequence.environment, sequence.first_ns
    if sequence.attitude is not None and len(sequence.attitude.q):
        return record_of_attitudes(sequence.attitude, given, first_ns=first)
    if sequence.tracks is not None and len(sequence.tracks.feature):
        return record_of_attitudes(_attitudes_of_tracks(sequence), given, first_ns=first)
    if sequence.rates is not None and len(sequence.rates.w):
        return record_of_rates(sequence.rates, first)
    raise NotPossible(
        "the sequence holds no attitudes, no body rates and no stereo tracks: give it attitude0, imu0 or tracks0"
    )


def _attitudes_of_tracks(sequence: Sequence) -> AttitudeSeries:
    """Attitudes as each epoch of stereo tracks alone shows them."""
    from massprops.estimators.start import first_guess
    from massprops.model.problem import problem_of

    problem = problem_of(sequence)
    if not problem.stereo:
        raise NotPossible(
            "tracks of one camera show no motion without attitude0, which 'massprops reconstruct' writes for an object that "
            "tumbles"
        )
    poses = first_guess(problem).poses
    if poses is None:
        raise NotPossible("the tracks show no attitude: at each epoch both cameras must see three features off a line")
    return AttitudeSeries(problem.stamp_ns[poses.rows], poses.q, np.asarray(poses.sigma))
