"""Format numbers, shares and intervals for the report; an unknown value is a dash."""

from math import isfinite, isnan

from study.statistics.intervals import Interval, Share

DASH = "-"


def number(value: float, digits: int = 2) -> str:
    """Format a number; a dash if it is not finite."""
    return f"{value:.{digits}f}" if isfinite(value) else DASH


def percent(rate: float, digits: int = 1) -> str:
    """Format a rate in percent, never rounded up to 100 or down to 0."""
    if isnan(rate):
        return DASH
    text = f"{100.0 * rate:.{digits}f}"
    if rate < 1.0 and float(text) == 100.0:
        return f">{100.0 - 10.0**-digits:.{digits}f}"
    if rate > 0.0 and float(text) == 0.0:
        return f"<{10.0**-digits:.{digits}f}"
    return text


def share(found: Share, digits: int = 1) -> str:
    """Format a share in percent with its interval."""
    if not found.of:
        return DASH
    low, high = found.interval
    return f"{percent(found.rate, digits)} [{percent(low, digits)}, {percent(high, digits)}]"


def interval(found: Interval, digits: int = 2) -> str:
    """Format an interval; an unbounded end is a dash, as is a fully unbounded interval."""
    if not (isfinite(found.low) or isfinite(found.high)):
        return DASH
    return f"[{number(found.low, digits)}, {number(found.high, digits)}]"


def probability(p: float) -> str:
    """Format a p-value."""
    if isnan(p):
        return DASH
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}" if p < 0.1 else f"{p:.2f}"


def count(value: int) -> str:
    """Format a count with thousands separators."""
    return f"{value:,}"
