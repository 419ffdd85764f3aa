"""Table-top scenes rendered with known truth, and the judge of a run on one of them."""
