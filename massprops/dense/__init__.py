"""Dense points on a CPU: PatchMatch multi-view stereo on the pixels of the object."""
