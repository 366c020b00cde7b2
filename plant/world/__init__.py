"""World files: read, checked, written."""
