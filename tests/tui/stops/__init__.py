"""Test the band, the bell and the confirmations around a stop."""
