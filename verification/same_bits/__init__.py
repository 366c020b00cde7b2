"""Proof that trajectories are the same to the last bit, whatever computes them."""
