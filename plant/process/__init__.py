"""The plant process on the bus."""
