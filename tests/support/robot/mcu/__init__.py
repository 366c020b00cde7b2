"""The firmware's main loop on CPython, in place of an emulated board."""
