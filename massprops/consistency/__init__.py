"""Cross-check: the mesh's inertia compared with every estimator's on the same footage."""

from massprops.consistency.crosscheck import crosscheck

__all__ = ["crosscheck"]
