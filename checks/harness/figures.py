"""A measured figure with its threshold, and the report of a benchmark with its machine."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from statistics import median
from typing import NamedTuple


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A quantity with one value per repetition; its median is compared with the threshold."""

    name: str
    unit: str
    values: tuple[float, ...]
    at_least: float | None = None
    at_most: float | None = None

    def __post_init__(self) -> None:
        if not self.values:
            raise ValueError(f"{self.name}: nothing was measured")

    @property
    def median(self) -> float:
        """The median of all repetitions."""
        return median(self.values)

    @property
    def met(self) -> bool | None:
        """True if the median is within the thresholds; None without a threshold."""
        if self.at_least is None and self.at_most is None:
            return None
        low = self.at_least is None or self.median >= self.at_least
        high = self.at_most is None or self.median <= self.at_most
        return low and high

    def line(self) -> str:
        """Return name, median, unit, range and verdict as one line."""
        spread = ""
        if len(self.values) > 1:
            low, high = digits(min(self.values)), digits(max(self.values))
            spread = f"({low} to {high}, {len(self.values)} times)"
        return (
            f"{self.name:<50} {digits(self.median):>9} {self.unit:<7} {spread:<32}{self._wanted()}"
        )

    def as_json(self) -> dict[str, object]:
        """Return the figure as a JSON object."""
        return {
            "name": self.name,
            "unit": self.unit,
            "median": self.median,
            "minimum": min(self.values),
            "maximum": max(self.values),
            "values": list(self.values),
            "at_least": self.at_least,
            "at_most": self.at_most,
            "met": self.met,
        }

    def _wanted(self) -> str:
        if self.met is None:
            return ""
        wanted = f">= {self.at_least:g}" if self.at_least is not None else f"<= {self.at_most:g}"
        return f"{wanted:<10} {'met' if self.met else 'MISSED'}"


def figure(
    name: str,
    values: float | Iterable[float],
    unit: str = "",
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Figure:
    """Return a figure with one value, or with the values of all repetitions."""
    found = tuple(values) if isinstance(values, Iterable) else (+values,)
    return Figure(name=name, unit=unit, values=found, at_least=at_least, at_most=at_most)


Measured = tuple[list[Figure], list[str]]
"""The figures and notes of a part of a benchmark."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkReport:
    """The figures of a benchmark, with notes and the machine that ran it."""

    benchmark: str
    figures: tuple[Figure, ...]
    notes: tuple[str, ...] = ()
    machine: dict[str, object] = field(default_factory=dict)

    @classmethod
    def of(cls, benchmark: str, parts: Iterable[Measured]) -> "BenchmarkReport":
        """Return the report of a benchmark in several parts."""
        measured = list(parts)
        figures = tuple(figure for found, _ in measured for figure in found)
        notes = tuple(note for _, found in measured for note in found)
        return cls(benchmark=benchmark, figures=figures, notes=notes)

    @property
    def met(self) -> bool:
        """True if no figure misses its threshold."""
        return all(figure.met is not False for figure in self.figures)

    def text(self) -> str:
        """Return the report as text, one figure per line."""
        lines = [f"{self.benchmark}:"]
        lines += [f"  {figure.line()}".rstrip() for figure in self.figures]
        lines += [f"  note: {note}" for note in self.notes]
        if self.machine:
            lines.append("  machine: " + ", ".join(f"{k} {v}" for k, v in self.machine.items()))
        return "\n".join(lines)

    def as_json(self) -> dict[str, object]:
        """Return the report as a JSON object."""
        return {
            "benchmark": self.benchmark,
            "met": self.met,
            "figures": [figure.as_json() for figure in self.figures],
            "notes": list(self.notes),
            "machine": self.machine,
        }


class BenchmarkFunctions(NamedTuple):
    """A benchmark among several of its module: how it adds its options, and how it measures."""

    add_options: Callable[[argparse.ArgumentParser], None]
    measure: Callable[[argparse.Namespace], BenchmarkReport]


def digits(value: float) -> str:
    """Format a value with four significant digits."""
    if value == 0 or abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.4g}"


def percentile(values: list[float], share: float) -> float:
    """Return the value that `share` (0 to 1) of all values do not exceed (nearest rank)."""
    if not values:
        raise ValueError("no values")
    ordered = sorted(values)
    return ordered[max(0, ceil(share * len(ordered)) - 1)]


def ratios(over: list[float], under: list[float]) -> tuple[float, ...]:
    """Divide pair by pair, so that a load that slows both measurements of a pair cancels out."""
    return tuple(a / b for a, b in zip(over, under, strict=True))


CPUINFO = Path("/proc/cpuinfo")


def machine_model() -> str:
    """Return the name of the processor."""
    if CPUINFO.exists():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def machine_load() -> float:
    """Return the number of runnable processes, ours included, averaged over the last minute."""
    return os.getloadavg()[0]


def describe_machine(load_before: float) -> dict[str, object]:
    """Return processor, cores, Python and load, and real-time scheduling if in use."""
    found: dict[str, object] = {
        "cpu": machine_model(),
        "cores": len(os.sched_getaffinity(0)),
        "python": ".".join(map(str, sys.version_info[:3])),
        "load": f"{load_before:.1f} -> {machine_load():.1f}",
    }
    if os.sched_getscheduler(0) in (os.SCHED_RR, os.SCHED_FIFO):
        found["scheduling"] = "real-time, ahead of other work"
    return found
