"""Which value to use, the mesh's or that of mesh and motion together, and why: `recommended` of `massprops.json`.

Every exporter writes these values, and every command prints them first.
"""

from __future__ import annotations

from typing import Any

VALUES = ("volume", "mass", "center_of_mass", "inertia", "principal_moments", "principal_axes")
"""Keys of a document that the recommended block has too."""
WELL_MEASURED = 0.85
"""Share of the surface above which a mesh is not moved out of its own interval: little of it is left to be wrong, so a
motion that asks for more is likelier wrong itself."""
MESH_ALONE = "from the mesh alone: nothing else was measured"


def by_mesh(document: dict[str, Any], because: str = MESH_ALONE) -> dict[str, Any]:
    """The `recommended` block of a run that has only its mesh.

    Args:
        document: `massprops.json`.
        because: why, one sentence.
    """
    return _block("mesh", document, because)


def recommend(document: dict[str, Any], crosscheck: dict[str, Any]) -> dict[str, Any]:
    """The block after the cross-check.

    Mesh and motion together where they agree and the two together are sharper than the mesh, in its moments or in their ratios; else
    the mesh. (A mesh whose unseen sides were chosen by the centre of mass has narrow moments; its ratios know nothing of the motion.)

    Args:
        document: `massprops.json`; crosscheck: `crosscheck.json`.
    """
    verdict, fused = crosscheck.get("verdict"), crosscheck.get("fused")
    if verdict == "inconsistent":
        return by_mesh(
            document, "from the mesh alone: shape and motion contradict each other, so they are not combined"
        )
    if verdict != "consistent":
        return by_mesh(
            document, f"from the mesh alone: the motion adds nothing ({crosscheck.get('reason', 'no cross-check')})"
        )
    if not fused:
        return by_mesh(
            document,
            "from the mesh alone: the motion agrees, but the run has no replicates with which to combine the two",
        )
    sharper = _sharper(document, fused)
    if not sharper:
        return by_mesh(document, "from the mesh alone: the motion agrees with it, but does not make it more certain")
    seen = (document.get("surface") or {}).get("observed_fraction") or 0.0
    if seen > WELL_MEASURED and (leaving := _left_interval(document, fused)):
        return by_mesh(document, f"from the mesh alone: combined with the motion, {leaving} would leave the interval of a "
                                 f"mesh that was measured on {100 * seen:.0f} % of its surface")  # fmt: skip
    together = (
        f"from mesh and motion ({fused.get('with', 'motion')}) together: they agree, and together they give {sharper}"
    )
    return _block("fused", fused, together)


def as_recommended(document: dict[str, Any]) -> dict[str, Any]:
    """The document with the recommended values in place of the mesh's; unchanged if it has none."""
    block = document.get("recommended")
    if not block:
        return document
    values = {key: block[key] for key in (*VALUES, "interval_90") if block.get(key) is not None}
    return {**document, **values, "inertia_ratios": {"k1": block["k1"], "k2": block["k2"]}}


def quantities(document: dict[str, Any]) -> dict[str, tuple[float, Any]]:
    """Value and 90 % interval (None without) of each scalar of a document, by its name for people; I1 to I3 ascend."""
    bounds = document.get("interval_90") or {}
    by_name = {name: (document[name], bounds.get(name)) for name in ("volume", "mass")}
    for key, name in (("center_of_mass", "centre of mass {}"), ("principal_moments", "I{}")):
        ends = bounds.get(key) or [None] * 3
        each = "xyz" if key == "center_of_mass" else "123"
        by_name |= {name.format(each[i]): (value, ends[i]) for i, value in enumerate(document[key])}
    return by_name | {k: (document["inertia_ratios"][k], bounds.get(k)) for k in ("k1", "k2")}


def relative_width(values: dict[str, Any]) -> float | None:
    """Mean half width of the 90 % intervals of the principal moments, over the moments; None without intervals."""
    bounds = (values.get("interval_90") or {}).get("principal_moments")
    if not bounds or any(end is None for pair in bounds for end in pair):
        return None
    halves = [(high - low) / (2 * m) for (low, high), m in zip(bounds, values["principal_moments"], strict=True)]
    return float(sum(halves) / 3)


def _sharper(document: dict[str, Any], fused: dict[str, Any]) -> str:
    """What mesh and motion together give more surely than the mesh, and how surely; empty if nothing."""
    mesh_width, fused_width = relative_width(document), relative_width(fused)
    if mesh_width is None or fused_width is None:
        return ""
    if fused_width < mesh_width:
        return f"the principal moments to ±{_percent(fused_width)} % instead of the mesh's ±{_percent(mesh_width)} %"
    mesh_k, fused_k = _ratio_widths(document), _ratio_widths(fused)
    if mesh_k is None or fused_k is None or sum(fused_k) >= sum(mesh_k):
        return ""
    return f"k1 to ±{fused_k[0]:.2g} and k2 to ±{fused_k[1]:.2g} instead of the mesh's ±{mesh_k[0]:.2g} and ±{mesh_k[1]:.2g}"


def _ratio_widths(values: dict[str, Any]) -> tuple[float, float] | None:
    """Half widths of the 90 % intervals of k1 and k2; None without."""
    interval = values.get("interval_90") or {}
    (low1, high1), (low2, high2) = (interval.get(name) or (None, None) for name in ("k1", "k2"))
    if low1 is None or high1 is None or low2 is None or high2 is None:
        return None
    return (high1 - low1) / 2, (high2 - low2) / 2


def _left_interval(document: dict[str, Any], fused: dict[str, Any]) -> str:
    """Which number of the fused body lies outside the mesh's own 90 % interval; empty if none."""
    interval, k = document["interval_90"], fused["inertia_ratios"]
    rows = [("the volume", fused["volume"], interval.get("volume"))]
    rows += [(f"I{i + 1}", m, interval["principal_moments"][i]) for i, m in enumerate(fused["principal_moments"])]
    rows += [(name, k[name], interval.get(name)) for name in ("k1", "k2")]
    return next((name for name, value, ends in rows if ends and not ends[0] <= value <= ends[1]), "")


def _block(source: str, values: dict[str, Any], because: str) -> dict[str, Any]:
    return {
        "source": source,
        **{key: values[key] for key in VALUES},
        "k1": values["inertia_ratios"]["k1"],
        "k2": values["inertia_ratios"]["k2"],
        "interval_90": values.get("interval_90") or {},
        "because": because,
    }


def _percent(share: float) -> str:
    return f"{100 * share:.2g}"
