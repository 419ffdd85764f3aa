"""Scenarios with known truth: a tumbling body before a still camera, or a camera that walks round a still object."""

from massprops.simulation.simulate import simulate

__all__ = ["simulate"]
