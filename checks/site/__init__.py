"""The documentation site: generated pages, pictures, the build and the check of its links."""
