"""Shared code of all verbs: the verb table, safe terminal output, package checks."""
