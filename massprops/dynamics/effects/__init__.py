"""One file per physical effect on the target's motion; see `massprops.effects`."""
