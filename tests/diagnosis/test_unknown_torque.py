"""What is told of a torque that no effect names: its history with a band, and what it goes along with."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.candidate import Selection
from massprops.diagnosis.diagnose import BalanceDiagnosis, residual_table
from massprops.diagnosis.document import gap, latent, where
from massprops.diagnosis.hypothesis_fit import torque_sd
from massprops.diagnosis.page import _over_time, _torque
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.unnamed import inertial_torque, without_effects


@pytest.fixture(scope="module")
def found() -> BalanceDiagnosis:
    """A torque that wanders in body axes, in Basilisk, of which the catalogue was not asked."""
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("unsteady", 2, seconds=450.0)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    other = inertial_torque(record, unknown)
    assert other is not None
    s = Selection(base=base, unknown=unknown, tried=(), verdict="unexplained", named=(), others=(other,))
    return BalanceDiagnosis(document={"latent": latent(s)}, model={}, record=record, selection=s)


def test_the_torque_has_a_band_that_narrows_where_it_was_seen(found: BalanceDiagnosis) -> None:
    fit = found.selection.with_torque
    assert fit is max(found.selection.unknowns, key=lambda f: f.evidence)
    sd, size = torque_sd(fit), np.abs(fit.torque).max()
    assert sd.shape == fit.torque.shape and (sd > 0.0).all() and sd[len(sd) // 2].max() < size
    assert sd[0].min() > sd[len(sd) // 2].max(), "at the ends half as much is seen of it"


def test_the_table_holds_torque_and_sigma(found: BalanceDiagnosis) -> None:
    rows = list(csv.DictReader(residual_table(found).splitlines()))
    value, sigma = (
        np.array([float(r["before [sigma]"]) for r in rows if r["channel"] == f"{what} [rad s^-2]"])
        for what in ("torque", "torque sigma")
    )
    assert len(value) == len(sigma) == 3 * len(found.record.times) and (sigma > 0.0).all()


def test_places_are_as_large_as_their_residuals(found: BalanceDiagnosis) -> None:
    """They were cut at 30 sigmas once, so that where a record fails most, all places were alike."""
    base = found.selection.base
    far = replace(base, residual=base.residual * 100.0 / np.sqrt(np.mean(base.residual**2)))
    told = [w["size"] for w in where(replace(found.selection, base=far))]
    assert max(told) > 100.0 and told == sorted(told, reverse=True)


def test_the_document_and_the_page_tell_it(found: BalanceDiagnosis) -> None:
    told, beside = latent(found.selection), gap(found.selection)["fitted"]
    assert 0.0 < told["shown_sigma"] < told["shown_rms"]
    assert {c["with"].split(" by ")[1].split()[0] for c in told["correlates"]} <= {"rate", "Sun", "field", "nadir"}
    assert beside["beside_unknown"] < 1.1 < beside["before"] == beside["after"]
    shown = _torque(found)
    assert shown.count('class="band"') == 3 and "goes along with" in shown
    (drawn,) = _over_time(found)
    assert "with an unknown torque" in drawn and drawn.count("<polyline") == 3
