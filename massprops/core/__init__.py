"""Files, processes and text: what every other package uses."""
