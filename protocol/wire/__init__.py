"""Messages as bytes: fields, packing, codec."""
