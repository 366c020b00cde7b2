"""Certificates of a bus with TLS: an authority, and a certificate and key for each role."""
