"""The toy daemon in real time, and an operator who waits until he sees what he expects."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from joint_thread import PERIOD_S
from toy_daemon import Daemon, Operator, law_payload

LIMIT_S = 60.0  # far too large; it only ends a test that hangs


def slow_law() -> dict:
    """What is late on a loaded machine is no fault here; what never comes is."""
    payload = law_payload()
    payload["timing"]["period_s"] = PERIOD_S
    payload["safety"]["encoder_timeout_s"] = 5.0
    payload["safety"]["tx_unconfirmed_periods"] = 10
    return payload


def until(condition: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + LIMIT_S
    while not (found := condition()):
        assert time.monotonic() < end, what
        time.sleep(0.02)
    return found


def mode_of(operator: Operator) -> str:
    return operator.ask(command="status")["mode"]


def arm(operator: Operator) -> None:
    until(lambda: operator.ask(command="arm")["ok"], "the daemon does not arm")
    until(lambda: mode_of(operator) == "ACTIVE", "the daemon does not become ACTIVE")


def reset_and_arm(operator: Operator) -> None:
    """Again and again: the cause may last some periods longer."""
    until(lambda: operator.ask(command="reset")["ok"], "the daemon does not reset")
    arm(operator)


def fault(daemon: Daemon) -> int:
    """The number of the latched fault once the motion has stopped for it."""
    operator = daemon.operator()
    until(lambda: mode_of(operator) == "FAULT", "no fault stops the motion")
    reply = operator.ask(command="arm")
    assert not reply["ok"], "armed in spite of a latched fault"
    assert mode_of(operator) == "FAULT"
    return reply["fault_number"]
