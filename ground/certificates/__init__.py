"""Who may join a locked bus: an authority, and for each role a certificate and its key."""
