"""Serve the ground station to browsers: the same app, behind a token."""

from ground.web.command import arguments, serve

__all__ = ["arguments", "serve"]
