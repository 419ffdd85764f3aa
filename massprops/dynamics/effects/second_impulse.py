"""A second knock, apart from the first: what bounces strikes more than once."""

from massprops.dynamics.effects.impulse import (
    FORMULA,
    MOMENTS,
    MOMENTUM_UNKNOWNS,
    NEEDS,
    PARAMETERS,
    displacement,
    jump,
    momentum_columns,
    momentum_scan,
    momentum_steps,
    momentum_variants,
    starts,
    torque,
)

NAME = "second-impulse"
SENTENCE = "A second knock at another moment: what struck once bounced, or a thruster fired twice."
BESIDE = "impulse"
SEARCHED = False  # the balance of momentum finds it

__all__ = [
    "BESIDE", "FORMULA", "MOMENTS", "MOMENTUM_UNKNOWNS", "NAME", "NEEDS", "PARAMETERS", "SEARCHED", "SENTENCE", "displacement", "jump",
    "momentum_columns", "momentum_scan", "momentum_steps", "momentum_variants", "starts", "torque",
]  # fmt: skip
