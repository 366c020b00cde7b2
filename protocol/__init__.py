"""The protocol between robot, plant and ground: dialect, wire format, topics and bus."""
