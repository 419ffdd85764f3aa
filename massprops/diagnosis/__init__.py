"""What a record's rigid-body model lacks, from the balance of angular momentum."""
