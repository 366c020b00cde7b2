"""The Methodic Configurator 5.0: its backend, which sets vehicles up and does not drive them."""

import os
from functools import partial
from typing import Any, Final

from ardupilot_methodic_configurator.backend_flightcontroller import FlightController

from tests.interop.clients.steps import (
    LONG_S,
    PARAMETER,
    VALUE,
    Call,
    StepError,
    Steps,
    called,
    repeat,
)

RECORDINGS: Final = "/recordings/"


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("Methodic Configurator")
    os.chdir(call.folder)  # it writes files of parameters
    controller: Any = FlightController(network_ports=[])
    with steps.step("connect", is_needed=True):
        errors: list[str] = []
        user_repeats(
            lambda: errors.append(controller.connect(call.endpoint)), lambda: not errors[-1]
        )
    with steps.step("parameters"):
        user_repeats(controller.download_params, lambda: controller.fc_parameters)
        steps.note(f"{len(controller.fc_parameters)} parameters")
        if PARAMETER not in controller.fc_parameters:
            raise StepError(f"no {PARAMETER} among {len(controller.fc_parameters)} parameters")
    with steps.step("set_parameter"):
        user_repeats(
            partial(set_parameter, controller), lambda: controller.fc_parameters[PARAMETER] == VALUE
        )
    with steps.step("log"):
        read_recording(controller, call)
    controller.disconnect()
    steps.end()


def user_repeats(act: Any, condition: Any) -> None:
    """Repeat what the backend has given up, as its user does."""
    repeat(act, condition, "its result", every_s=0.0, within_s=LONG_S)


def set_parameter(controller: Any) -> None:
    """Set a parameter, and read it back, which the backend does only once."""
    sent, words = controller.set_param(PARAMETER, VALUE)
    if not sent:
        raise StepError(words)
    try:
        controller.fetch_param(PARAMETER, timeout=2)
    except TimeoutError:
        controller.fc_parameters[PARAMETER] = None


def read_recording(controller: Any, call: Call) -> None:
    """Read the recording that the robot lists, and compare it."""
    listed: list[Any] = []
    user_repeats(
        lambda: listed.extend(controller.list_remote_files(RECORDINGS) or ()), lambda: listed
    )
    entry = next(one for one in listed if one.name == call.recording.name)
    path = call.folder / "downloaded.tlog"
    done: list[bool] = []
    user_repeats(
        lambda: done.append(controller.download_remote_file(entry.remote_path, str(path))),
        lambda: done[-1],
    )
    call.require_recording(path)
    # The backend asks for the checksum once, and waits for half a minute.
    user_repeats(
        lambda: done.append(controller.verify_remote_file(entry.remote_path, str(path))),
        lambda: done[-1],
    )


if __name__ == "__main__":
    main()
