"""Modelled cost of the control core on a microcontroller."""
