"""One file per method, one interface."""

from massprops.estimators.estimate import estimate

__all__ = ["estimate"]
