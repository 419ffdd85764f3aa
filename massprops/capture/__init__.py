"""Footage in: reads video, image folders and sequences; picks frames; finds silhouettes."""
