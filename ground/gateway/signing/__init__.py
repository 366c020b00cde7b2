"""Signatures of MAVLink 2: keys, verification, and what unsigned clients may do."""
