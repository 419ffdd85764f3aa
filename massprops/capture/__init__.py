"""Footage in: reads video, image folders and sequences; picks frames; finds silhouettes."""

from massprops.capture.frames import Frame, read_frames

__all__ = ["Frame", "read_frames"]
