"""The MAVLink dialect of the project, and the wire layouts that `make generate` derives from it."""
