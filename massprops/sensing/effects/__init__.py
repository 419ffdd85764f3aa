"""One file per sensing effect, found by its name."""
