"""One file per method, one interface."""
