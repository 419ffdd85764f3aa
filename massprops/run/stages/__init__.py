"""One file per stage of a reconstruction."""
