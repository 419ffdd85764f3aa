"""The cross-check's verdict as a reason for less confidence in `massprops.json`."""

from __future__ import annotations

import json
from typing import Any

from massprops.core.files import write_json
from massprops.core.outputs import Outputs
from massprops.mass.confidence import lowered

BY = "reconstruct"
"""The command whose confidence it is."""


def judged(trust: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """The confidence of the reconstruction alone, one level lower where shape and motion contradict."""
    if verdict.get("verdict") != "inconsistent":
        return trust
    return lowered(trust, f"shape and motion contradict each other: {verdict['reason']}")


def enter_confidence(outputs: Outputs, verdict: dict[str, Any]) -> dict[str, Any] | None:
    """Writes the confidence anew: see `judged`.

    What the reconstruction alone came to stands in `work/mass`, so the same verdict does not lower it twice.

    Args:
        outputs: of a run folder that the caller holds.
        verdict: `crosscheck.json`.

    Returns:
        the confidence, or None where the run has none of its own.
    """
    path, own = outputs.folder / "massprops.json", outputs.folder / "work" / "mass" / "massprops.json"
    entry = outputs.files.get("massprops.json")
    if entry is None or entry["by"] != BY or not own.is_file() or not outputs.intact("work/mass"):
        return None
    document, trust = json.loads(path.read_text()), json.loads(own.read_text()).get("confidence")
    if trust is None:
        return None
    trust = judged(trust, verdict)
    if document.get("confidence") != trust:
        document["confidence"] = trust
        write_json(outputs.staging() / "massprops.json", document)
        rest = [name for name, e in outputs.files.items() if e["by"] == BY and name != "massprops.json"]
        outputs.publish(BY, entry["key"], keep=rest, keep_old=False)
    return trust
