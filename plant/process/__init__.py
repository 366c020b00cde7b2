"""The plant as a process on the bus."""
