"""Report of a study: one HTML page, Markdown, and the README's table."""
