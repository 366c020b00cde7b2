"""Mutual TLS: certificates, permissions, and the log of refused peers."""
