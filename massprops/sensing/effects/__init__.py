"""One file per effect on what the sensors say; see `massprops.effects`."""
