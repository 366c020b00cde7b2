"""Network faults injected for tests."""
