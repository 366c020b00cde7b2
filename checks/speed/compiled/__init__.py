"""Compiled and pure trials, compared with each other and with ir-sim."""
