"""Write `.tlog` and `.mcap` recordings, and read either of them."""
