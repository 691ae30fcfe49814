"""Coulomb friction and the Bouc–Wen loop: off by default, bounded, dissipative."""

import math
from collections.abc import Callable

import pytest
from eampc_rig import Rig, RigError

from plant_emulator.friction import Friction
from plant_emulator.plant import Plant


def test_off_unless_asked_for(reference_rig: Rig) -> None:
    friction = Friction.from_rig(reference_rig.emulator)
    assert friction.torque_N_m(1.0, 0.5) == 0.0
    assert friction.hysteresis_rate_per_s(1.0, 0.5) == 0.0


def test_coulomb_brakes_with_its_full_torque_in_motion() -> None:
    friction = Friction(coulomb_N_m=0.2)
    assert friction.torque_N_m(0.5, 0.0) == pytest.approx(0.2)
    assert friction.torque_N_m(-0.5, 0.0) == pytest.approx(-0.2)
    assert friction.torque_N_m(0.0, 0.0) == 0.0


def test_coulomb_slows_the_joint_as_by_hand(rig_with: Callable[..., Rig]) -> None:
    """Without pressure: J ω̇ = −b_v ω − T_c, so ω = (ω0 + T_c/b_v) e^(−b_v t/J) − T_c/b_v."""
    rig = rig_with(emulator__coulomb_friction_N_m=0.2, emulator__initial_velocity_rad_s=2.0)
    plant = Plant(rig)
    for frame in range(10):
        plant.begin_frame(frame)
        plant.advance_to(0.005)
    expected = (2.0 + 0.4) * math.exp(-10.0 * 0.05) - 0.4
    assert plant.velocity_rad_s == pytest.approx(expected, rel=1e-9)


def test_too_few_substeps_for_the_friction_are_refused(rig_with: Callable[..., Rig]) -> None:
    rig = rig_with(emulator__coulomb_friction_N_m=5.0)
    # 5 / (0.05 · 0.01) = 10000/s; times 5 ms over 2 = 25 steps.
    with pytest.raises(RigError, match=r"substeps is 10, but .* needs at least 25"):
        Plant(rig)


def test_bouc_wen_loop_closes_saturates_and_dissipates() -> None:
    friction = Friction(hysteresis_N_m=0.3, hysteresis_width_rad=0.05)
    step, z, angle, work, highest = 1e-4, 0.0, 0.0, 0.0, 0.0
    turns: list[float] = []
    for index in range(3 * 20000):
        velocity = 0.5 * math.cos(math.pi * index * step)
        z += step * friction.hysteresis_rate_per_s(velocity, z)
        angle += step * velocity
        work += step * velocity * friction.torque_N_m(velocity, z)
        highest = max(highest, abs(z))
        if index % 20000 == 19999:
            turns.append(z)
    assert highest <= 1.0 + 1e-9
    assert highest > 0.98  # the stroke is 0.16 rad each way, six widths over all
    assert turns[1] == pytest.approx(turns[2], abs=1e-6)
    assert work > 0.0
