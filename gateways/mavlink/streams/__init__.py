"""Telemetry: the messages that a vehicle sends periodically, and their rates for each client."""
