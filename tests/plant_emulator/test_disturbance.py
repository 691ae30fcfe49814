"""Each term of the contract, by hand."""

import math
from typing import Any

import pytest
from eampc_rig import DisturbanceTerm
from pydantic import TypeAdapter

from plant_emulator.disturbance import Disturbance


def disturbance(*terms: dict[str, Any]) -> Disturbance:
    return Disturbance([TypeAdapter(DisturbanceTerm).validate_python(term) for term in terms])


@pytest.mark.parametrize(
    ("term", "time_s", "value"),
    [
        ({"kind": "constant", "amplitude_rad_s2": 3.0}, -1.0, 3.0),
        ({"kind": "step", "amplitude_rad_s2": 30.0, "start_s": 3.0}, 2.999, 0.0),
        ({"kind": "step", "amplitude_rad_s2": 30.0, "start_s": 3.0}, 600 * 0.005, 30.0),
        ({"kind": "step", "amplitude_rad_s2": 30.0, "start_s": 0.0}, -0.005, 0.0),
        ({"kind": "step", "amplitude_rad_s2": 30.0}, 0.0, 30.0),
        ({"kind": "sine", "amplitude_rad_s2": 2.0, "frequency_hz": 0.5}, 0.5, 2.0),
        ({"kind": "sine", "amplitude_rad_s2": 2.0, "frequency_hz": 0.5}, -0.5, 0.0),
        ({"kind": "pulse", "amplitude_rad_s2": 4.0, "start_s": 1.0, "end_s": 2.0}, 0.99, 0.0),
        ({"kind": "pulse", "amplitude_rad_s2": 4.0, "start_s": 1.0, "end_s": 2.0}, 1.0, 4.0),
        ({"kind": "pulse", "amplitude_rad_s2": 4.0, "start_s": 1.0, "end_s": 2.0}, 2.0, 0.0),
        ({"kind": "sine_of_state_sum", "amplitude_rad_s2": 20.0}, -1.0, 20 * math.sin(0.7)),
        ({"kind": "cosine_of_state_sum", "amplitude_rad_s2": 0.5}, 1.0, 0.5 * math.cos(0.7)),
    ],
)
def test_one_term(term: dict[str, Any], time_s: float, value: float) -> None:
    assert disturbance(term).value_rad_s2(time_s, 0.3, 0.4) == pytest.approx(value, abs=1e-12)


def test_terms_add_and_jumps_are_listed() -> None:
    total = disturbance(
        {"kind": "sine_of_state_sum", "amplitude_rad_s2": 20.0},
        {"kind": "step", "amplitude_rad_s2": 30.0, "start_s": 3.0},
        {"kind": "pulse", "amplitude_rad_s2": -5.0, "start_s": 1.0, "end_s": 3.0},
    )
    assert total.jumps_s == (1.0, 3.0)
    assert total.value_rad_s2(3.0, 0.0, 0.0) == pytest.approx(30.0)
    assert total.value_rad_s2(2.0, 0.0, 0.0) == pytest.approx(-5.0)
