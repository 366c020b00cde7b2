"""The ground station in a browser: the same app, behind a door that opens only with a token."""

from ground.web.command import arguments, serve

__all__ = ["arguments", "serve"]
