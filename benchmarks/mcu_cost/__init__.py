"""Modelled cost of the control core on the LPC1768."""
