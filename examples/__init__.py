"""Five programs that use Sidestep's Python API; each can be run as a script."""
