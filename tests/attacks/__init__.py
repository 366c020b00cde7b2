"""What a process that is no part of the stack sends, and what must not come of it."""
