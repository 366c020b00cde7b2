"""MCAP files: read and written."""
