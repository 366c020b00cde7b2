"""Verbs that observe, record and explain."""
