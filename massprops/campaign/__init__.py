"""Many runs: a grid or a random draw, on this machine's cores or on a Dask cluster, into a store that survives."""

from massprops.campaign.run import Outcome, run_campaign

__all__ = ["Outcome", "run_campaign"]
