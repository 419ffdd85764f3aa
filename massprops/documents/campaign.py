"""Campaign YAML: what `massprops campaign` runs. Parameters of the kind of run stand beside these keys."""

from __future__ import annotations

from typing import Annotated, Any

from massprops.documents.fields import Names, Nested, Number, Text, document

MOST_CHUNK = 10_000
LARGEST_SEED = 2**31 - 1


@document()
class LimitsFile:
    """Limits of one run."""

    time_s: Annotated[float, Number("wall time", "s", 1e-3, 1e7)] | None = None
    memory_mb: Annotated[float, Number("memory", "MB", 16, 1e8)] | None = None


@document(others="ignored")
class CampaignFile:
    """A campaign: a grid or a random draw of seeded runs."""

    kind: Annotated[str, Text("kind of run, a name of `massprops.campaigns.kinds`")]
    name: Annotated[str, Text("for people")] | None = None
    runs: Annotated[int, Number("seeds for each point of the grid", "", 1, 10**12, whole=True)] | None = None
    seed: Annotated[int, Number("the first seed", "", 0, LARGEST_SEED, whole=True)] = 0
    chunk: Annotated[int, Number("runs that one worker does together", "", 1, MOST_CHUNK, whole=True)] | None = None
    grid: Annotated[dict[str, Any], Names("lists of values by parameter; every combination is run")] | None = None
    draw: Annotated[dict[str, Any], Names("distributions by parameter, as `{uniform: [0, 1]}`")] | None = None
    limits: Annotated[LimitsFile, Nested("limits of one run")] | None = None
