"""The camera-and-range unscented filter of volpe2017."""
