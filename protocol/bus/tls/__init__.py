"""Mutual TLS and access control."""
