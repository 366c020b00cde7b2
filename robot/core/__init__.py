"""The control core, which also runs under MicroPython; it imports only `math` and itself."""
