"""Files for clients: the FTP server with its virtual tree, recordings, and the LOG protocol."""
