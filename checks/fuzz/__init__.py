"""Fuzz every decoder with broken inputs."""
