"""Tests of the black box."""
