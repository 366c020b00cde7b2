"""The clients of the gateway: their frames in both directions, and the list of present clients."""
