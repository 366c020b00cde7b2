"""COMMAND_LONG, COMMAND_INT and SET_MODE: one table of commands; each is acknowledged once."""
