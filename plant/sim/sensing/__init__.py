"""Sonars: rays, surfaces, echoes."""
