"""Many trials: planned, run on all cores or a cluster, stored."""
