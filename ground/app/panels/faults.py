"""What can go wrong on purpose, as rows: now, or in a world that is started anew."""

from typing import Final, NamedTuple

from ground.app.widgets.rows import Row, Span, faint, head, row

HOW: Final = "TARGET [VALUE] [FROM_S]"


class Trouble(NamedTuple):
    """`kind` of the plant, or what happens to the process of a `role`."""

    name: str
    says: str
    role: str = ""
    kind: str = ""
    targets: tuple[str, ...] = ()
    unit: str = ""


def heading_row(ours: bool) -> Row:
    if not ours:
        return row(" what can go wrong", faint("   these are not ours: sidestep up has its own"))
    return row(
        " what can go wrong",
        faint("   now: at once   anew: ends what runs, starts the world with it"),
    )


def trouble_row(one: Trouble, chosen: bool) -> Row:
    when = "now  " if one.role else "anew "
    name = Span(f"{one.name:<18}", "reverse" if chosen else "text")
    return row(faint(f" {when}"), name, f" {one.says}")


def about_rows(one: Trouble | None) -> list[Row]:
    if one is None:
        return [row(faint(" reading ..."))]
    first = row(Span(f" {one.name}", "accent"), f"  {one.says}")
    if one.role:
        return [first, row(faint(" s does it now"))]
    targets = ", ".join(one.targets) or "no target"
    return [
        first,
        row(head(" targets "), targets, head("   value in "), one.unit or "no unit"),
        row(faint(f" s asks for {HOW}; then what runs ends, and the world starts anew with it")),
    ]
