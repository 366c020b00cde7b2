"""Sonar simulation: rays, surfaces and echoes."""
