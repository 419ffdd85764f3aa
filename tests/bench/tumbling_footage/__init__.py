"""Tumbling bodies before a black sky, rendered with known truth by the table-top scenes' renderer."""
