"""Start, supervise and end the processes of `up`."""
