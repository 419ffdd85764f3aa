"""Scenarios with known truth: a tumbling body before a still camera, or a camera that walks round a still object."""

from massprops.simulate.simulate import simulate

__all__ = ["simulate"]
