"""A law for what is in no catalogue: sparse regression in the balance of momentum, over a library of terms with units."""
