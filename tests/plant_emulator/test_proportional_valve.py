"""Equation (2) with a lag."""

import math

import pytest

from plant_emulator.proportional_valve import ProportionalValve

K0 = 0.09e6  # Pa/V


def test_step_response_is_first_order() -> None:
    valve = ProportionalValve(K0, 0.0, 10.0, 0.03, 0.0)
    valve.command(5.0)
    for time_s in (0.0, 0.005, 0.03, 0.09):
        expected = 0.45e6 * (1.0 - math.exp(-time_s / 0.03))
        assert valve.after(time_s) == pytest.approx(expected, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize(("command_V", "applied_V"), [(12.0, 10.0), (-3.0, 0.0), (7.5, 7.5)])
def test_command_is_cut_to_the_range(command_V: float, applied_V: float) -> None:
    valve = ProportionalValve(K0, 0.0, 10.0, 0.03, 0.0)
    valve.command(command_V)
    assert valve.voltage_V == applied_V
    assert valve.after(10.0) == pytest.approx(K0 * applied_V)


def test_ideal_valve_follows_at_once() -> None:
    valve = ProportionalValve(K0, -30.0, 35.0, None, 2.0)
    assert valve.pressure_Pa == K0 * 2.0
    valve.command(-7.7)
    assert valve.pressure_Pa == pytest.approx(-0.693e6)
    assert valve.after(0.005) == valve.pressure_Pa
