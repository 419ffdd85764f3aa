"""Enters the cross-check's verdict into `massprops.json`: the confidence and the recommended values."""

from __future__ import annotations

import json
from typing import Any

from massprops.core.files import write_json
from massprops.core.outputs import Outputs
from massprops.mass.confidence import lowered
from massprops.mass.recommended import recommend

BY = "reconstruct"
"""The command whose document it is."""


def judged(document: dict[str, Any], measured: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """`massprops.json` as the cross-check leaves it: less confidence where shape and motion contradict each other, and
    the values of mesh and motion together where they agree.

    What the reconstruction alone came to is taken from `measured`, so the same verdict does not lower it twice.

    Args:
        document: `massprops.json` as it stands; measured: as the mass stage made it; verdict: `crosscheck.json`, or {}.
    """
    changed = dict(document)
    trust = measured.get("confidence")
    if trust is not None:
        reason = f"shape and motion contradict each other: {verdict.get('reason')}"
        changed["confidence"] = lowered(trust, reason) if verdict.get("verdict") == "inconsistent" else trust
    if verdict and measured.get("recommended") is not None:
        changed["recommended"] = recommend(document, verdict)
    return changed


def enter_verdict(outputs: Outputs, verdict: dict[str, Any]) -> dict[str, Any] | None:
    """Writes `massprops.json` anew: see `judged`.

    Args:
        outputs: of a run folder that the caller holds.
        verdict: `crosscheck.json`.

    Returns:
        the confidence, or None where the run has none of its own.
    """
    path, mass_stage_file = outputs.folder / "massprops.json", outputs.folder / "work" / "mass" / "massprops.json"
    entry = outputs.files.get("massprops.json")
    if entry is None or entry["by"] != BY or not mass_stage_file.is_file() or not outputs.intact("work/mass"):
        return None
    document = json.loads(path.read_text())
    changed = judged(document, json.loads(mass_stage_file.read_text()), verdict)
    if changed != document:
        write_json(outputs.staging() / "massprops.json", changed)
        rest = [name for name, e in outputs.files.items() if e["by"] == BY and name != "massprops.json"]
        outputs.publish(BY, entry["key"], keep=rest, keep_old=False)
    confidence: dict[str, Any] | None = changed.get("confidence")
    return confidence
