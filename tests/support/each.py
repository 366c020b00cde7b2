"""`each`: a table of cases that is one test. `pytest.mark.parametrize` makes a test of each row."""

import asyncio
import inspect
from collections.abc import Callable, Coroutine, Iterable, Sequence
from functools import wraps
from typing import Any, Final, cast

import pytest
from _pytest.outcomes import OutcomeException

MAX_SHOWN: Final = 200
"""The longest description of a row in a report, in characters."""
Test = Callable[..., Coroutine[Any, Any, None] | None]


class Row(dict[str, Any]):
    """The arguments of one case, by name."""

    def __str__(self) -> str:
        text = ", ".join(f"{name}={value!r}" for name, value in self.items())
        return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def each(names: str | Sequence[str], rows: Iterable[Any]) -> Callable[[Test], Test]:
    """Call a test for each row of a table, and report every row that fails, with its values.

    The table has the form that `pytest.mark.parametrize` takes; two tables make each combination.
    The rows are one test, so that a long table costs no more than its calls. All rows get the same
    fixtures: where a fixture keeps a state that a row would leave to the next, parametrize.

    Raises:
        ValueError: The table is empty, or a row has another number of values than there are names.
    """
    keys = names.replace(",", " ").split() if isinstance(names, str) else list(names)
    table = [row_of(keys, row) for row in rows]
    if not table:
        raise ValueError(f"no rows for {', '.join(keys)}: the test could not fail")

    def decorate(test: Test) -> Test:
        joined = vars(test)["__wrapped__"] if hasattr(test, "rows") else test
        inner: list[Row] = getattr(test, "rows", [Row()])
        combined = [Row(row | more) for more in inner for row in table]

        @wraps(joined)
        def run(subtests: pytest.Subtests, **fixtures: Any) -> None:
            for row in combined:
                try:
                    story = joined(**fixtures, **row)
                    if inspect.iscoroutine(story):
                        asyncio.run(story)
                except (Exception, OutcomeException) as error:
                    with subtests.test(str(row)):
                        raise error

        known = set().union(*combined)
        given = inspect.signature(joined).parameters.values()
        fixtures = [parameter for parameter in given if parameter.name not in known]
        own = inspect.Parameter("subtests", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        vars(run)["__signature__"] = inspect.Signature([own, *fixtures])
        vars(run)["rows"] = combined
        return cast(Test, run)

    return decorate


def row_of(keys: Sequence[str], row: Any) -> Row:
    """Return the arguments of a row: one value for one name, else a sequence of values."""
    values = (row,) if len(keys) == 1 else tuple(row)
    if len(values) != len(keys):
        raise ValueError(f"{len(values)} values for {', '.join(keys)}: {row!r}")
    return Row(zip(keys, values, strict=True))
