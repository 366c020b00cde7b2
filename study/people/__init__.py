"""Measure contacts with people and nearness to them, beside two baselines in the same worlds."""
