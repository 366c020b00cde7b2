"""Model one robot: its state, its lease, the requests to it."""
