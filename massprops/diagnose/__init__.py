"""Where simulation and measurement disagree, which effect is missing, and the model with it."""

from massprops.diagnose.diagnose import diagnose

__all__ = ["diagnose"]
