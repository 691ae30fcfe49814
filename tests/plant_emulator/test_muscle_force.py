"""Equation (3) against numbers worked out by hand."""

import pytest
from eampc_rig import Rig

from plant_emulator.muscle_force import MuscleForce


@pytest.mark.parametrize(
    ("pressure_MPa", "contraction", "k4_N", "force_N"),
    [
        (0.45, 0.1, 0.0, 427.5),  # 0.45 (100 - 750 + 1600)
        (0.45, 0.2, 0.0, 225.0),  # 0.45 (400 - 1500 + 1600)
        (0.45, 0.2, -20.0, 205.0),
        (0.0, 0.1, 7.0, 7.0),
        (-0.1, 0.0, 0.0, -160.0),  # beyond physics: just computed
    ],
)
def test_force_by_hand(
    reference_rig: Rig, pressure_MPa: float, contraction: float, k4_N: float, force_N: float
) -> None:
    muscle = reference_rig.muscle.model_copy(update={"k4_N": k4_N})
    force = MuscleForce.from_rig(muscle).force_N(pressure_MPa * 1e6, contraction)
    assert force == pytest.approx(force_N, rel=1e-12)
