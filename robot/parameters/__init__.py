"""The robot's parameters: their table, and the service that reads and sets them."""
