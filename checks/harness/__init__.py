"""Run the stack for tests, benchmarks and campaigns: in one process or as real processes."""
