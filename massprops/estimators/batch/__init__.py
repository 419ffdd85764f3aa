"""Batch least squares over the whole record: the reference that every other estimator is measured against."""
