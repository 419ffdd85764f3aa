"""What stands still behind an object that turns."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_silhouettes_again import SIZE, views

from massprops.run.job import Job, ReconstructOptions
from massprops.run.stage_images import still_backgrounds


@pytest.mark.parametrize("background", ["still", "black"])
def test_gaps_in_what_moves_do_not_stand_still(tmp_path: Path, background: str) -> None:
    here = views(1)
    job = Job(run=tmp_path, options=ReconstructOptions(), out=tmp_path / "out")
    file = job.work("capture") / "masks" / f"{here.names[0]}.png"
    assert still_backgrounds(job, here) is None, "nothing was told from it"
    moves = np.zeros(SIZE[::-1], np.uint8)
    moves[60:180, 100:220] = 255
    moves[90:120, 130:190] = 0
    moves[140:146, 100:220] = 0
    file.parent.mkdir(parents=True)
    cv2.imwrite(str(file), moves)
    (job.work("capture") / "footage.json").write_text(
        json.dumps({"background": background, "motion": "tumbling", "masks_given": False})
    )
    still = still_backgrounds(job, here)
    if background == "black":
        assert still is None
        return
    assert still is not None and len(still) == 1
    found = still[0]
    assert not found[62:178, 102:218].any()
    assert found[:55].all() and found[:, :95].all() and found[:, 225:].all()
