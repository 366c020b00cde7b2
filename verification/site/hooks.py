"""Hooks of MkDocs, named in mkdocs.yml."""
