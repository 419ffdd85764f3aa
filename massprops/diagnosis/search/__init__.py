"""Where simulation and measurement disagree, which effect is missing, and the model with it."""

from massprops.diagnosis.search.diagnose import diagnose

__all__ = ["diagnose"]
