"""The clients of the gateway: their frames in both directions, and which of them are there."""
