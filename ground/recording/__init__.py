"""Recordings: what is written besides the `.tlog`, and everything that is read from either."""
