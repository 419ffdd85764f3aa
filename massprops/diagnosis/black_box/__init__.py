"""A user's own simulator as a hypothesis: a black box from parameters to measurements, with finite differences."""
