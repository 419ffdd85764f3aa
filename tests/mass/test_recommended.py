"""Which values a run recommends, and that all that is not said otherwise is the mesh's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from massprops.documents.fields import read
from massprops.documents.massprops_json import MassFile
from massprops.mass.document import document
from massprops.mass.properties import mass_properties
from massprops.mass.recommended import as_recommended, recommend


def widths(found: dict[str, Any], half: float) -> dict[str, Any]:
    """Intervals of so much on either side of each moment and of the volume."""
    around = {"volume": [found["volume"] * (1 - half), found["volume"] * (1 + half)]}
    around["principal_moments"] = [[m * (1 - half), m * (1 + half)] for m in found["principal_moments"]]
    return {**found, "interval_90": around}


@pytest.fixture
def mesh() -> dict[str, Any]:
    found = mass_properties(trimesh.creation.box((1.0, 2.0, 3.0)), 1000.0)
    surface = {"watertight": True, "observed_fraction": 0.6}
    return widths(document(found, {}, {"source": "given", "metres_per_unit": 1.0}, surface, []), 0.2)


def fused(mesh: dict[str, Any], half: float, grown: float = 1.0) -> dict[str, Any]:
    keys = ("volume", "mass", "center_of_mass", "inertia", "principal_moments", "principal_axes", "inertia_ratios")
    both = {key: mesh[key] for key in keys}
    for key in ("volume", "mass", "inertia", "principal_moments"):
        both[key] = (np.array(both[key]) * grown).tolist()
    return {"with": "smoother", **widths(both, half)}


def test_a_document_recommends_its_mesh_until_more_is_known(mesh: dict[str, Any]) -> None:
    assert mesh["recommended"]["source"] == "mesh" and mesh["recommended"]["volume"] == mesh["volume"]
    read(MassFile, mesh, "massprops.json")
    assert as_recommended({key: v for key, v in mesh.items() if key != "recommended"})["volume"] == mesh["volume"]


def test_both_together_where_they_agree_and_are_sharper(mesh: dict[str, Any]) -> None:
    verdict = {"verdict": "consistent", "fused": fused(mesh, 0.05, 1.1)}
    block = recommend(mesh, verdict)
    assert block["source"] == "fused" and "±5 % instead of the mesh's ±20 %" in block["because"]
    whole = as_recommended({**mesh, "recommended": block})
    assert whole["volume"] == pytest.approx(1.1 * mesh["volume"])
    assert whole["interval_90"]["volume"][0] == pytest.approx(0.95 * 1.1 * mesh["volume"])
    assert whole["inertia_ratios"] == mesh["inertia_ratios"] and whole["density"] == mesh["density"]
    read(MassFile, {**mesh, "recommended": block}, "massprops.json")


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        ({"verdict": "inconsistent"}, "contradict"),
        ({"verdict": "unobservable", "reason": "flat spin"}, "flat spin"),
        ({"verdict": "consistent", "fused": None}, "no replicates"),
        ({"verdict": "consistent", "fused": 0.3}, "more certain"),
    ],
)
def test_else_the_mesh_and_why(mesh: dict[str, Any], verdict: dict[str, Any], said: str) -> None:
    if verdict.get("fused"):
        verdict = {**verdict, "fused": fused(mesh, verdict["fused"])}
    block = recommend(mesh, verdict)
    assert block["source"] == "mesh" and said in block["because"] and block["mass"] == mesh["mass"]


def test_sharper_ratios_are_enough(mesh: dict[str, Any]) -> None:
    """The mesh's moments are narrow where its unseen sides were chosen by the motion's centre of mass."""
    both = fused(mesh, 0.3, 1.1)
    for found, half in ((mesh, 0.2), (both, 0.01)):
        found["interval_90"] |= {name: [k - half, k + half] for name, k in mesh["inertia_ratios"].items()}
    block = recommend(mesh, {"verdict": "consistent", "fused": both})
    assert block["source"] == "fused" and "k1 to ±0.01 and k2 to ±0.01 instead of the mesh's ±0.2" in block["because"]


def test_a_well_measured_mesh_is_not_moved_out_of_its_interval(mesh: dict[str, Any]) -> None:
    verdict = {"verdict": "consistent", "fused": fused(mesh, 0.05, 1.3)}
    assert recommend(mesh, verdict)["source"] == "fused"
    well = {**mesh, "surface": {"observed_fraction": 0.9}}
    block = recommend(well, verdict)
    assert block["source"] == "mesh" and "the volume would leave the interval" in block["because"]
