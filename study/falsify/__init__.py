"""A search for worlds in which a navigator violates what is stated about it."""
