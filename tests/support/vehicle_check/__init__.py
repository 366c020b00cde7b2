"""Vehicles in this process for tests of the judge."""
