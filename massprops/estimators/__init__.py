"""Estimators of motion and inertia ratios: `estimate` runs them, `methods` holds one file each."""
