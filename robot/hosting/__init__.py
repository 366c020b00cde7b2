"""The control core behind one interface: in this process, or on a board at a serial line."""
