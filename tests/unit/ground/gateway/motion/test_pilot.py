from gateways.mavlink.motion.pilot import EnterGuided
from protocol.wire.enums import Command, Mode
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.client import Stage


@each("aborted", [Reason.NONE, Reason.NO_GOAL])
def test_entering_guided_drops_the_goal_first(aborted: Reason) -> None:
    stage = Stage(aborted, Reason.NONE, attended=True)
    assert EnterGuided().perform(stage.session).ok
    abort, mode = stage.bus.requests
    assert abort.command == Command.SIDESTEP_ABORT_GOAL
    assert (mode.command, mode.param2) == (Command.DO_SET_MODE, Mode.GUIDED)
