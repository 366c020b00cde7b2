"""Programs that search for violations of the stack's safety properties."""
