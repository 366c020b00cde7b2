"""Services that every process needs: clocks, settings, files and errors."""
