"""The robot's parameters: their table and the service that sets them."""
