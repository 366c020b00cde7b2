"""Run one trial in this process and re-execute recorded drives."""
