"""Volume, centre of mass, inertia, principal frame, and the interval each of them deserves."""
