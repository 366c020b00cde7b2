"""The sockets and serial lines of the gateway. Only this package does I/O with clients."""
