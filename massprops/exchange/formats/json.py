"""JSON: the whole `massprops.json` with its convention spelled out."""

from __future__ import annotations

import json
from collections.abc import Mapping

from massprops.exchange.body import CONVENTION, Body

NAME = "json"
SUFFIX = ".json"
NEEDS_METRES = False
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The document as text; mass and inertia are the body's own, should a mass have been given."""
    heading = {"name": body.name, "convention": CONVENTION, "remarks": list(body.remarks[1:])}
    restated = {
        "mass": body.mass,
        "inertia": body.inertia.tolist(),
        "density": body.mass / body.document["volume"],
        "principal_moments": [m * body.mass / body.document["mass"] for m in body.document["principal_moments"]],
    }
    return json.dumps({**heading, **body.document, **restated}, indent=2) + "\n"
