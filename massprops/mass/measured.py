"""What a user asks of a measured body, by short names: `volume`, `inertia`, `interval`, `mesh`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from massprops.core.displayed import Displayed, number
from massprops.mass.recommended import as_recommended

if TYPE_CHECKING:
    import numpy as np


class Measured(Displayed):
    """The values of a `massprops.json` as attributes. Where the document recommends values, these are given.

    Lengths are in metres and masses in kilograms when `metric` is True, else in model units.
    """

    @property
    def properties(self) -> dict[str, Any]:
        """The whole `massprops.json`."""
        raise NotImplementedError

    @property
    def metric(self) -> bool:
        """Whether the scale is known: lengths in metres."""
        return bool(self.properties["units"]["length"] == "m")

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(self._value("volume"))

    @property
    def mass(self) -> float:
        """Density times volume [kg]."""
        return float(self._value("mass"))

    @property
    def density(self) -> float:
        """Density [kg/m^3]; 1000 (water) if none was given, see `density_assumed`."""
        return float(self.properties["density"])

    @property
    def density_assumed(self) -> bool:
        """Whether 1000 kg/m^3 (water) was assumed because no density was given."""
        return bool(self.properties.get("density_assumed", False))

    @property
    def center_of_mass(self) -> np.ndarray:
        """(3,) the centre of mass in the mesh's axes [m]."""
        return self._array("center_of_mass")

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3) inertia tensor about the centre of mass in the mesh's axes, tensor signs [kg m^2]."""
        return self._array("inertia")

    @property
    def principal_moments(self) -> np.ndarray:
        """(3,) principal moments of inertia, ascending [kg m^2]."""
        return self._array("principal_moments")

    @property
    def principal_axes(self) -> np.ndarray:
        """(3, 3) principal axes as unit columns in the mesh's axes, right-handed."""
        return self._array("principal_axes")

    @property
    def k1(self) -> float:
        """ln(I1/I2), free of scale and density."""
        return self._ratio("k1")

    @property
    def k2(self) -> float:
        """ln(I2/I3), free of scale and density."""
        return self._ratio("k2")

    @property
    def interval(self) -> dict[str, np.ndarray]:
        """90 % intervals by name: (2,) of a number, (3, 2) of three; empty for a finished mesh of exact scale."""
        import numpy as np

        bounds = self._value("interval_90") or {}
        return {name: np.array(pair, float) for name, pair in bounds.items() if pair is not None}

    @property
    def confidence(self) -> str:
        """`high`, `medium` or `low`; empty for a finished mesh, which is not judged."""
        return str((self.properties.get("confidence") or {}).get("level", ""))

    def facts(self) -> dict[str, str]:
        """Volume, mass, moments with their intervals, and the confidence; without a scale, volume and ratios."""
        bounds = self.interval
        if not self.metric:  # without a length neither mass nor moments mean anything
            shown = {"volume": number(self.volume, bounds.get("volume"), "unit^3")}
            shown |= {k: number(getattr(self, k), bounds.get(k)) for k in ("k1", "k2")}
        else:
            moments = bounds.get("principal_moments", [None] * 3)
            assumed = " (density assumed: water)" if self.density_assumed else ""
            shown = {
                "volume": number(self.volume, bounds.get("volume"), "m^3"),
                "mass": number(self.mass, bounds.get("mass"), "kg") + assumed,
            }
            shown |= {f"I{i + 1}": number(m, moments[i], "kg m^2") for i, m in enumerate(self.principal_moments)}
        if self.confidence:
            shown["confidence"] = self.confidence
        return shown

    def _value(self, name: str) -> Any:
        return as_recommended(self.properties).get(name)

    def _array(self, name: str) -> np.ndarray:
        import numpy as np

        return np.array(self._value(name), float)

    def _ratio(self, name: str) -> float:
        return float(self._value("inertia_ratios")[name])
