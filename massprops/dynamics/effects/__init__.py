"""One file per physical effect on the motion of the target, found by its name."""
