import gc
import os
import sys
import threading

import pytest

from robot.core.parameters import DEFAULTS
from robot.run import FIFO_PRIORITY, SWITCH_S, Options, apply_options, share_interpreter, use_fifo
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import freeze_heap


@pytest.fixture(autouse=True)
def thawed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(sys, "setswitchinterval", lambda _: None)


def test_switch_interval_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    monkeypatch.setattr(sys, "setswitchinterval", seen.append)
    share_interpreter()
    assert seen == [SWITCH_S]
    assert SWITCH_S <= 0.001


def test_a_frozen_heap_needs_no_warning() -> None:
    assert freeze_heap() is None


def test_python_without_freeze_returns_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(gc, "freeze")
    assert "may stall the loop" in (freeze_heap() or "")


def test_refused_real_time_scheduling_returns_a_warning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    assert "CAP_SYS_NICE" in (use_fifo() or "")


def test_other_threads_are_scheduled_below_the_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: dict[int, int] = {}

    def give(thread: int, _policy: int, param: os.sched_param) -> None:
        if thread == gone:
            raise ProcessLookupError(3, "No such process")
        given[thread] = param.sched_priority

    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    gone = other.native_id
    monkeypatch.setattr(os, "sched_setscheduler", give)
    assert use_fifo() is None
    gone = None
    assert use_fifo() is None
    done.set()
    other.join()
    assert given[0] == FIFO_PRIORITY
    assert other.native_id is not None
    assert given[other.native_id] < FIFO_PRIORITY
    assert threading.get_native_id() not in given


def test_any_other_failure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def failed(*_: object) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "sched_setscheduler", failed)
    assert "Invalid argument" in (use_fifo() or "")


def test_system_without_it_returns_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    assert "not available" in (use_fifo() or "")


def test_failed_option_is_announced_on_the_bus(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    vehicle = Vehicle(DEFAULTS, Store(None))
    apply_options(vehicle, Options(fifo=True))
    assert "warning: real-time scheduling" in capsys.readouterr().err
    assert any("real-time scheduling" in text.text for text in vehicle.texts())


def test_unselected_options_are_not_applied(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(gc, "freeze")
    monkeypatch.delattr(os, "sched_setscheduler")
    apply_options(Vehicle(DEFAULTS, Store(None)), Options(freeze=False))
    assert capsys.readouterr().err == ""
