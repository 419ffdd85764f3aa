"""Points, poses and the centre of mass from measured positions, without dynamics."""
