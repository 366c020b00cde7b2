"""A UDP relay that loses, delays and reorders datagrams in both directions."""
