"""Build the firmware from the sources of the core, of its main loop and of MicroPython."""
