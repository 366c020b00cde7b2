"""The generator of the modules derived from the dialect, and pymavlink's module to compare with."""
