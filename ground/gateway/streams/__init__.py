"""Telemetry: the messages that a vehicle sends by itself, and how often each client gets them."""
