"""What a stop must look like on the wire, written down from the rig file alone.

An oracle for the command frames of a run: hold (saturate), ramp to valve.bias_V (saturate,
soft_stop), ramp to valve.safe_V (these and vent_ramp), each of safety.soft_stop_ramp_s; immediate
is valve.safe_V and the enable bit 0 in the very frame. A stronger action cuts into a weaker one.
"""

from __future__ import annotations

import numpy as np
from eampc_rig import Rig
from numpy.typing import NDArray

STRENGTH = ("saturate", "soft_stop", "vent_ramp", "immediate")

Array = NDArray[np.float64]


def stop_frames(
    rig: Rig, last_V: tuple[float, float], begins: dict[int, str], count: int, below_bias: bool
) -> Array:
    """(count, 3): u1 in V, u2 in V, enable bit in the periods after the first action.

    last_V      voltages of the frame before
    begins      period (0: the first row) → action that begins there if it is the stronger one
    below_bias  the arming ramp was still on its way up: saturate and soft_stop go straight down
    """
    periods = round(rig.safety.soft_stop_ramp_s / rig.control.period_s)
    bias, safe = rig.valve.bias_V, rig.valve.safe_V
    rows = np.empty((count, 3))
    phase, done, start, now = -1, 0, last_V, last_V
    at_rest = False
    for row in range(count):
        if phase >= 0:
            done += 1
        action = begins.get(row)
        if action is not None and not at_rest:
            wanted = STRENGTH.index(action)
            if below_bias and row == 0 and action in ("saturate", "soft_stop"):
                wanted = STRENGTH.index("vent_ramp")
            # The phase that ended with the period before is over when the action is weighed.
            phase, done, start = _passed(phase, done, start, periods, bias)
            if wanted > phase:
                phase, done, start = wanted, 1, now
        phase, done, start = _passed(phase, done, start, periods, bias)
        at_rest = at_rest or phase >= STRENGTH.index("immediate")
        if at_rest:
            now = (safe, safe)
        elif phase > 0:
            target = bias if phase == 1 else safe
            share = 1.0 if periods == 0 else done / periods
            now = tuple(u + (target - u) * share for u in start)  # type: ignore[assignment]
        rows[row] = (*now, 0.0 if at_rest else 1.0)
    return rows


def _passed(
    phase: int, done: int, start: tuple[float, float], periods: int, bias: float
) -> tuple[int, int, tuple[float, float]]:
    """(phase, periods done in it, where it began) after phases that are over."""
    while 0 <= phase < STRENGTH.index("immediate") and done > periods:
        done -= periods
        if phase == 1:
            start = (bias, bias)
        phase += 1
    return phase, done, start
