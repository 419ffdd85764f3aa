"""The mesh, to turn: measured grey, filled in red, inferred blue, or the photographs' colours; axes and camera path."""

from __future__ import annotations

import numpy as np

from massprops.report.data import RunData
from massprops.report.html import number, swatch, text
from massprops.report.viewer import viewer

TITLE, ORDER = "Shape", 1


def render(data: RunData) -> str:
    """The viewer with its mesh inside."""
    if data.shape is None:
        return ""
    axes = data.document.get("principal_axes")
    keys = [swatch("#bdc4cc", "measured")]
    inferred = data.shape.inferred if data.shape.inferred is not None else np.zeros(len(data.shape.faces), bool)
    if not (data.shape.observed | inferred).all():
        keys.append(swatch("#db332a", "filled in, not measured"))
    if inferred.any():
        keys.append(swatch("#0a84e3", "inferred: closed at the plane it stood on"))
    if axes:
        keys += [swatch("#f27326", "axis of I1"), swatch("#40b359", "I2"), swatch("#4d8cfa", "I3")]
        keys.append(swatch("#fac72e", "centre of mass"))
    size = np.ptp(data.shape.vertices, axis=0)
    extent = " × ".join(number(float(v), 4) for v in size)
    unit = "m" if data.metric else "model units" if data.document else "arbitrary units"
    return (
        viewer(
            data.shape.vertices,
            data.shape.faces,
            observed=data.shape.observed,
            centre=data.centre if axes else None,
            axes=np.array(axes) if axes else None,
            cameras=data.camera_centres,
            inferred=data.shape.inferred,
            rgb=data.shape.rgb,
        )
        + f'<p class="soft keys">{"".join(keys)}</p>'
        + f'<p class="soft">Extent along the mesh\'s own axes: {text(extent)} {unit}. '
        + "Drag to turn, wheel or two fingers to come closer, arrow keys when it has the focus.</p>"
    )
