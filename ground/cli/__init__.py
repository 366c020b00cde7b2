"""One module per verb: parse arguments, call the client, print."""
