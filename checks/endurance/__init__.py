"""Drive a fleet for a long time while faults happen; measure growth, latency and losses."""
