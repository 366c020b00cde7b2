"""Verbs that start processes or prepare them."""
