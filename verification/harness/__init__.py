"""What tests, benchmarks and campaigns run the stack with."""
