"""Keep the garbage collector from stalling a process with deadlines."""

import gc


def freeze_heap() -> str | None:
    """Exclude all present objects from garbage collection; return a warning if unavailable."""
    if not hasattr(gc, "freeze"):
        return "this Python cannot freeze its heap: a collection may stall the loop"
    gc.collect()
    gc.freeze()
    return None
