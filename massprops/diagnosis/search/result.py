"""What the search over starts found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from massprops.diagnosis.search.case import Case
    from massprops.diagnosis.search.select import Selection


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes:
        document: the content of `diagnosis.json`; model: of `model.yaml`.
        case, selection: the work behind it; torque: the recovered torque, when unexplained; history: momentum and energy.
        surface: (s, 3) points of a run's mesh from its centre of mass, where the body axes are the mesh's, or None.
        law: files of a law that was discovered, by name.
    """

    document: dict[str, Any]
    model: dict[str, Any]
    case: Case
    selection: Selection
    torque: dict[str, Any] | None
    history: dict[str, Any] | None
    surface: np.ndarray | None = None
    law: dict[str, str | bytes] = field(default_factory=dict)
