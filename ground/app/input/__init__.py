"""Turn bytes from a terminal into actions."""
