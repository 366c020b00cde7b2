"""The MAVLink dialect of the project, and the generator of the modules derived from it."""
