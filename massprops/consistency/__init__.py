"""Shape against motion: the mesh's inertia held against every estimator on the same footage."""

from massprops.consistency.crosscheck import crosscheck

__all__ = ["crosscheck"]
