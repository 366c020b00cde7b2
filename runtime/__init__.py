"""What every process needs and no domain owns: clocks, settings, files, errors."""
