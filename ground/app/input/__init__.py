"""From bytes of a terminal to actions."""
