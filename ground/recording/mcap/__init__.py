"""Read and write MCAP files."""
