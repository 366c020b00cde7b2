// MicroPython includes this file; this port has no terminal and no pins.
