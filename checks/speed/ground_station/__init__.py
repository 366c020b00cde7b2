"""Cost and latency of the app."""
