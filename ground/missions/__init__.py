"""Read, write, edit and transfer missions and fences."""
