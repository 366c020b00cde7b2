"""Plan many trials, run them on all cores or a cluster, and store their results."""
