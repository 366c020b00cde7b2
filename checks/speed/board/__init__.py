"""Cost of the control core on the emulated board."""
