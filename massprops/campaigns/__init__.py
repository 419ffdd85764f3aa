"""Many runs: a grid or a random draw, on this machine or on a Dask cluster, kept in a store that survives a crash.

`configuration` lays out the runs, `engine` brings them to a backend (`local`, `cluster`) and their rows to `store`;
`kinds/` holds what a run can be and `papers/` the published cases, one file each.
"""
