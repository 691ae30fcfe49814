"""The rig's mechanical end stops: rigid, without rebound."""

from __future__ import annotations

import math

from plant_emulator.integrator import JointState


def at_end_stop(state: JointState, end_stop_rad: float | None) -> JointState:
    """Return the state (θ rad, θ̇ rad/s, z) with |θ| ≤ end_stop_rad; None: the joint turns freely.

    Motion into a stop ends there; motion away from it is free.
    """
    angle, velocity, z = state
    if end_stop_rad is None or abs(angle) <= end_stop_rad:
        return state
    into_stop = angle * velocity > 0.0
    return math.copysign(end_stop_rad, angle), 0.0 if into_stop else velocity, z
