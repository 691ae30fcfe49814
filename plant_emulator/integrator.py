"""One classic Runge–Kutta step of the joint's state (θ rad, θ̇ rad/s, hysteresis z)."""

from __future__ import annotations

from collections.abc import Callable

JointState = tuple[float, float, float]
# (time s, state…, P1 Pa, P2 Pa) → (θ̈ rad/s², ż 1/s)
JointRates = Callable[[float, float, float, float, float, float], tuple[float, float]]


def rk4_step(
    rates: JointRates,
    time_s: float,
    step_s: float,
    state: JointState,
    pressures_Pa: tuple[float, float, float, float, float, float],
) -> JointState:
    """Return the state `step_s` later; fourth order.

    `pressures_Pa` are P1, P2 at the beginning, middle and end of the step: the valves are solved
    exactly beforehand and enter as known functions of time.
    """
    angle, velocity, z = state
    p1_begin, p2_begin, p1_mid, p2_mid, p1_end, p2_end = pressures_Pa
    half = 0.5 * step_s
    middle = time_s + half
    a1, z1 = rates(time_s, angle, velocity, z, p1_begin, p2_begin)
    v2 = velocity + half * a1
    a2, z2 = rates(middle, angle + half * velocity, v2, z + half * z1, p1_mid, p2_mid)
    v3 = velocity + half * a2
    a3, z3 = rates(middle, angle + half * v2, v3, z + half * z2, p1_mid, p2_mid)
    v4 = velocity + step_s * a3
    a4, z4 = rates(time_s + step_s, angle + step_s * v3, v4, z + step_s * z3, p1_end, p2_end)
    sixth = step_s / 6.0
    return (
        angle + sixth * (velocity + 2.0 * (v2 + v3) + v4),
        velocity + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        z + sixth * (z1 + 2.0 * (z2 + z3) + z4),
    )
