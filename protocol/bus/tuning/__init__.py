"""How this project tunes Zenoh: threads, full queues, closing of links."""
