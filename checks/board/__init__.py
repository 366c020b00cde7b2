"""An emulated board that a check can break."""
