"""The garbage collector, kept from stalling a process that has to be in time."""

import gc


def freeze_heap() -> str | None:
    """Move all that exists out of the collector's sight: no full collection stalls the loop.

    None when it worked, else the warning to show.
    """
    if not hasattr(gc, "freeze"):
        return "this Python cannot freeze its heap: a collection may stall the loop"
    gc.collect()
    gc.freeze()
    return None
