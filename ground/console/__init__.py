"""The command line in the app: the grammar of the shell, parsed into typed operations."""
