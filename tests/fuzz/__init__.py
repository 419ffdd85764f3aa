"""Hostile input: mutated files for every reader. `make fuzz` runs it long, the suite a few seconds of it."""
