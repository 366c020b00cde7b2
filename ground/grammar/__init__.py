"""The grammar of commands: words of a shell or of the app's command line to typed operations."""
