"""What every part stands on: files, processes, text for people."""
