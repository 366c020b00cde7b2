"""Generated text in a page written by hand, between two marks."""


def with_text(page: str, begin: str, end: str, text: str) -> str:
    """Return the page with this text between its marks; raise ValueError for a missing mark."""
    before, found_begin, rest = page.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found_begin and found_end):
        raise ValueError(
            f"the page has no {begin.strip()} and {end.strip()}; add both where the text goes"
        )
    return f"{before}{begin}{text}{end}{after}"
