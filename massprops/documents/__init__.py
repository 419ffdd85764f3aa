"""Every document and table that is read or written: one schema each, which also describes and refuses."""
