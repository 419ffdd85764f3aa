"""The run folder: what was asked, the stages in processes of their own, what came out."""
