"""Scenarios with known truth: rendered frames and tracks."""
