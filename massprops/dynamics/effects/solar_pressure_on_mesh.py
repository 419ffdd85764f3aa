"""Sunlight pushes on the faces of the body's own mesh, by what they absorb and send back."""

from functools import cache

from massprops.dynamics.kernels import to_body
from massprops.effects import Parameter

NAME = "solar-pressure-on-mesh"
SENTENCE = "Sunlight pushes on the lit faces of the body's mesh, by what they absorb, mirror and scatter."
FORMULA = (
    "force on a lit face = -area (n.s) ((absorbed + scattered) s + (2 mirrored n.s + 2/3 scattered) n), s toward the Sun, "
    "n the normal"
)
NOTE = (
    "The three are shares of the light times its pressure on the area of the whole surface, times the root of that area. Those with an "
    "axis are minus the same times the place of the centre of mass from where the mesh has it, over that root."
)
KINDS = ("absorbed", "mirrored", "scattered")
PARAMETERS = (
    *(Parameter(kind, "rad s^-2", 1e-5, 1.0, least=0.0) for kind in KINDS),
    *(Parameter(f"{kind}_{a}", "rad s^-2", 1e-6, 1.0) for kind in KINDS for a in "xyz"),
)
NEEDS = ("sun direction", "mesh")
BODY = tuple(q.name for q in PARAMETERS)
SEARCHED = False  # the balance of momentum finds it
OFF = 0.05
"""How far the centre of mass may lie from where the mesh has it, 1-sigma, over the root of the surface: a tenth of a cube's width."""


@cache
def momentum_prior():
    """(12, 12): the parameters of unknowns that are independent. Shares are as likely as those of `sunlit_bodies`."""
    import numpy as np

    from massprops.dynamics.sunlit_bodies import MOST_SENT_BACK

    mirrored, rest = np.random.default_rng(0).uniform(0.0, MOST_SENT_BACK, (2, 1000))
    scattered = (1.0 - mirrored) * rest
    shares = np.array([1.0 - mirrored - scattered, mirrored, scattered])
    half = np.linalg.cholesky(shares @ shares.T / shares.shape[1])
    out = np.zeros((12, 12))
    out[:3, :3], out[3:, 3:] = half, np.kron(half, OFF * np.eye(3))
    return out


def measured(given):
    """The effect of a mesh whose `faces` are given (`massprops.dynamics.mesh_faces`)."""
    from massprops.dynamics.mesh_faces import faces_of, functions_of

    return {
        "NEEDS": ("sun direction",),
        **functions_of(faces_of(given), lambda q, environment: to_body(*q, *environment.sun)),
    }
