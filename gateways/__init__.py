"""Gateways: robots of this stack, presented to the programs of others."""
