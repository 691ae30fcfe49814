"""The whole plant against scipy on equations (1) to (5), written here a second time."""

import math
import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from eampc_rig import Rig, load_rig
from scipy.integrate import solve_ivp

from plant_emulator.antagonistic_joint import AntagonisticJoint
from plant_emulator.emulator_error import EmulatorError
from plant_emulator.plant import Plant

RIGS = Path(__file__).parents[2] / "rigs"
T = 0.005


def right_hand_side(rig: Rig, u1_V: float, u2_V: float, disturbance: Callable) -> Callable:
    """ẏ of y = (θ, θ̇, P1 MPa, P2 MPa), as the paper prints it."""
    m, j, v = rig.muscle, rig.joint, rig.valve
    k0, tau = v.pressure_gain_MPa_per_V, rig.emulator.valve_time_constant_s
    r, length, e0 = j.gear_radius_m, m.initial_length_m, m.initial_contraction_ratio

    def rates(t: float, y: np.ndarray) -> list[float]:
        theta, omega, p1, p2 = y
        if tau is None:
            p1, p2 = k0 * u1_V, k0 * u2_V
        e1, e2 = e0 + r / length * theta, e0 - r / length * theta
        f1 = p1 * (m.k1_N_per_MPa * e1**2 + m.k2_N_per_MPa * e1 + m.k3_N_per_MPa) + m.k4_N
        f2 = p2 * (m.k1_N_per_MPa * e2**2 + m.k2_N_per_MPa * e2 + m.k3_N_per_MPa) + m.k4_N
        torque = f1 * r - f2 * r - j.viscous_damping_N_m_s_rad * omega
        acceleration = torque / j.moment_of_inertia_kg_m2 + disturbance(t, theta, omega)
        lag = 0.0 if tau is None else 1.0 / tau
        return [omega, acceleration, lag * (k0 * u1_V - p1), lag * (k0 * u2_V - p2)]

    return rates


def scenario_step(t: float, theta: float, omega: float) -> float:
    return 20.0 * math.sin(theta + omega) + (30.0 if t >= 0.1 else 0.0)


def test_trajectory_matches_scipy(reference_rig: Rig) -> None:
    rig = reference_rig
    terms = [
        rig.scenarios["step"].disturbance[0],
        rig.scenarios["step"].disturbance[1].model_copy(update={"start_s": 0.1}),
    ]
    plant = Plant(rig, terms)
    y = np.array([0.0, 0.0, 0.0, 0.0])
    sequence = random.Random(7)
    for frame in range(60):
        u = sequence.uniform(-8.0, 8.0)
        u1, u2 = 5.0 + 0.45 * u, 5.0 - 0.45 * u
        plant.begin_frame(frame)
        plant.command(u1, u2)
        plant.advance_to(T)
        # The solver gets each period alone, so that it never steps over a jump.
        middle = (frame + 0.5) * T
        rates = right_hand_side(rig, u1, u2, lambda t, a, b, m=middle: scenario_step(m, a, b))
        y = solve_ivp(rates, (0.0, T), y, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        truth = plant.snapshot()
        assert truth.angle_rad == pytest.approx(y[0], abs=2e-7)
        assert truth.velocity_rad_s == pytest.approx(y[1], abs=2e-5)
        assert truth.pressure1_kPa == pytest.approx(1e3 * y[2], rel=1e-9)
        assert truth.pressure2_kPa == pytest.approx(1e3 * y[3], rel=1e-9)
    assert abs(y[0]) > 0.01  # the joint did move


@pytest.mark.parametrize(("case", "kind"), [("paper-case1", math.sin), ("paper-case2", math.cos)])
def test_paper_cases_match_scipy(case: str, kind: Callable[[float], float]) -> None:
    rig = load_rig(RIGS / case, overrides={"emulator.linear_muscles": False})
    scenario = next(iter(rig.scenarios.values()))
    amplitude = scenario.disturbance[0].amplitude_rad_s2
    plant = Plant(rig, scenario.disturbance)
    u1, u2 = rig.valve.bias_V - 1.8, rig.valve.bias_V + 1.8
    y = np.array([rig.emulator.initial_angle_rad, rig.emulator.initial_velocity_rad_s, 0.0, 0.0])
    rates = right_hand_side(rig, u1, u2, lambda _, a, b: amplitude * kind(a + b))
    y = solve_ivp(rates, (0.0, 40 * T), y, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    for frame in range(40):
        plant.begin_frame(frame)
        plant.command(u1, u2)
        plant.advance_to(T)
    assert plant.angle_rad == pytest.approx(y[0], abs=1e-9)
    assert plant.velocity_rad_s == pytest.approx(y[1], abs=1e-9)


def test_linearisation_is_the_papers(reference_rig: Rig) -> None:
    """b = 38.475 and b1 = -309.375 of (9), by hand from the reference rig's numbers."""
    joint = AntagonisticJoint.from_rig(reference_rig.joint, reference_rig.muscle)

    def acceleration(angle: float, u: float) -> float:
        p1, p2 = 0.09e6 * (5.0 + 0.45 * u), 0.09e6 * (5.0 - 0.45 * u)
        return joint.acceleration_rad_s2(angle, 0.0, p1, p2, 0.0, 0.0)

    h = 1e-6
    assert (acceleration(0.0, h) - acceleration(0.0, -h)) / (2 * h) == pytest.approx(38.475)
    assert (acceleration(h, 0.0) - acceleration(-h, 0.0)) / (2 * h) == pytest.approx(-309.375)
    assert joint.acceleration_rad_s2(0.0, 1.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(-10.0)


def test_jump_between_two_substeps_acts_on_its_instant(reference_rig: Rig) -> None:
    """A jump off the substep grid: the same as integrating up to it and on from it."""
    term = reference_rig.scenarios["step"].disturbance[1].model_copy(update={"start_s": 0.00123})
    jumping, constant = Plant(reference_rig, [term]), Plant(reference_rig)
    jumping.begin_frame(0)
    jumping.advance_to(T)
    constant.begin_frame(0)
    constant.advance_to(0.00123)
    assert constant.velocity_rad_s == 0.0
    # 30 rad/s² against b2 = −10/s for 3.77 ms; at zero pressure nothing else acts.
    expected = 3.0 * (1.0 - math.exp(-10.0 * (T - 0.00123)))
    assert jumping.velocity_rad_s == pytest.approx(expected, rel=1e-10)


def test_parts_of_a_period_give_the_whole(reference_rig: Rig) -> None:
    whole, parts = Plant(reference_rig), Plant(reference_rig)
    for plant in (whole, parts):
        plant.begin_frame(0)
        plant.command(6.0, 4.0)
    whole.advance_to(T)
    for offset in (0.0004, 0.0011, 0.00307, T):
        parts.advance_to(offset)
    assert parts.angle_rad == pytest.approx(whole.angle_rad, abs=1e-10)
    assert parts.valve1.pressure_Pa == pytest.approx(whole.valve1.pressure_Pa, rel=1e-12)


def test_held_joint_stays_while_its_valves_fill(rig_with: Callable[..., Rig]) -> None:
    rig = rig_with(
        emulator__hold_until_start=True,
        emulator__initial_angle_rad=0.2,
        emulator__initial_velocity_rad_s=-1.0,
    )
    plant = Plant(rig, lead_frames=3)
    for frame in range(3):
        plant.begin_frame(frame)
        plant.command(5.0, 5.0)
        plant.advance_to(T)
        assert (plant.angle_rad, plant.velocity_rad_s) == (0.2, -1.0)
    assert plant.valve1.pressure_Pa > 0.1e6
    plant.begin_frame(3)
    assert plant.scenario_time_s == 0.0
    plant.advance_to(T)
    assert plant.angle_rad == pytest.approx(0.2 - T, abs=2e-3)
    assert plant.angle_rad != 0.2


def test_infinite_state_is_one_sentence(reference_rig: Rig) -> None:
    plant = Plant(reference_rig)
    plant._state = (math.inf, 0.0, 0.0)
    with pytest.raises(EmulatorError, match=r"no longer finite at 0\.000 s"):
        plant.advance_to(T)


def test_a_period_is_cheap(reference_rig: Rig) -> None:
    """0.07 ms measured for 5 ms of plant; the limit leaves room for a loaded machine."""
    plant = Plant(reference_rig, reference_rig.scenarios["step"].disturbance)
    best = math.inf
    for frame in range(300):
        plant.begin_frame(frame)
        begin = time.perf_counter()
        plant.advance_to(T)
        best = min(best, time.perf_counter() - begin)
    assert best < 0.3e-3


def test_end_stop_ends_the_motion_and_lets_go_again(reference_rig: Rig) -> None:
    emulator = reference_rig.emulator.model_copy(update={"end_stop_rad": 0.5})
    plant = Plant(reference_rig.model_copy(update={"emulator": emulator}))
    frame = 0
    for u1, u2, periods in ((9.0, 1.0, 200), (1.0, 9.0, 20)):
        for _ in range(periods):
            plant.begin_frame(frame)
            plant.command(u1, u2)
            plant.advance_to(T)
            assert abs(plant.angle_rad) <= 0.5
            frame += 1
        if u1 > u2:
            assert plant.angle_rad == 0.5
            assert plant.velocity_rad_s == 0.0
    assert plant.angle_rad < 0.4
