"""Words beside numbers."""

from massprops.core.text import counted


def test_one_is_singular():
    assert counted(1, "image was", "images were") == "1 image was"
    assert counted(0, "image was", "images were") == "0 images were"
    assert counted(7, "image was", "images were") == "7 images were"
