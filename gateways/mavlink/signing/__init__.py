"""Signatures of MAVLink 2: keys, verification, and the rights of unsigned clients."""
