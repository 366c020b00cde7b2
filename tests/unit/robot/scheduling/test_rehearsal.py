from robot.core.parameters import DEFAULTS
from robot.run import LEAD_NS, Rehearsal, RehearsingPulse

MS = 1_000_000
PATIENCE_NS = 12 * MS


class ScriptedPulse:
    """A pulse with scripted results of each wait."""

    def __init__(self, *answers: int | None) -> None:
        self.answers = list(answers)
        self.deadlines_ns: list[int] = []

    def wait_until(self, deadline_ns: int) -> int | None:
        self.deadlines_ns.append(deadline_ns)
        return self.answers.pop(0)


class Counted(Rehearsal):
    def __init__(self) -> None:
        super().__init__(DEFAULTS)
        self.runs = 0

    def run(self) -> object:  # type: ignore[override]
        self.runs += 1
        return super().run()


def rehearsed(*answers: int | None) -> tuple[RehearsingPulse, ScriptedPulse, Counted]:
    script, rehearsal = ScriptedPulse(*answers), Counted()
    return RehearsingPulse(script, rehearsal, PATIENCE_NS), script, rehearsal


def test_it_rehearses_shortly_before_the_frame_is_due() -> None:
    pulse, script, rehearsal = rehearsed(None, 50 * MS)
    assert pulse.wait_until(62 * MS) == 50 * MS
    assert script.deadlines_ns == [50 * MS - LEAD_NS, 62 * MS]
    assert rehearsal.runs == 1


def test_early_frame_is_not_delayed_by_a_rehearsal() -> None:
    pulse, _, rehearsal = rehearsed(40 * MS)
    assert pulse.wait_until(62 * MS) == 40 * MS
    assert rehearsal.runs == 0


def test_without_a_frame_the_deadline_ends_the_wait() -> None:
    pulse, script, rehearsal = rehearsed(None, None)
    assert pulse.wait_until(62 * MS) is None
    assert script.deadlines_ns[-1] == 62 * MS
    assert rehearsal.runs == 1


def test_rehearsals_are_independent() -> None:
    rehearsal = Rehearsal(DEFAULTS)
    first, second = rehearsal.run(), rehearsal.run()
    assert first == second
    assert first.left_mrad_s != 0
    assert first.right_mrad_s != 0
