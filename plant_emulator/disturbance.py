"""The disturbance d(t, x) in rad/s² as the sum of a scenario's terms.

t is scenario time. Before t = 0 the terms that depend on time are 0; constant and state terms act.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from eampc_rig.scenario_sections import DisturbanceTerm

# A jump meant for a frame's instant must not slip behind it by rounding of t = k T.
JUMP_TOLERANCE_S = 1e-9


class Disturbance:
    """A sum of terms, split into what jumps in time and what is smooth, so that an integrator can
    stop at the jumps (`jumps_s`, ascending) and hold the level between them."""

    def __init__(self, terms: Iterable[DisturbanceTerm]) -> None:
        self._constant = 0.0
        self._switches: list[tuple[float, float]] = []  # (time, change of the level)
        self._sines: list[tuple[float, float]] = []  # (amplitude, angular frequency rad/s)
        self._sine_of_sum = 0.0
        self._cosine_of_sum = 0.0
        for term in terms:
            amplitude = term.amplitude_rad_s2
            if term.kind == "constant":
                self._constant += amplitude
            elif term.kind == "step":
                self._switches.append((term.start_s, amplitude))
            elif term.kind == "pulse":
                self._switches += [(term.start_s, amplitude), (term.end_s, -amplitude)]
            elif term.kind == "sine":
                self._sines.append((amplitude, 2.0 * math.pi * term.frequency_hz))
            elif term.kind == "sine_of_state_sum":
                self._sine_of_sum += amplitude
            else:
                self._cosine_of_sum += amplitude
        self.jumps_s: tuple[float, ...] = tuple(sorted({time for time, _ in self._switches}))

    def level_rad_s2(self, time_s: float) -> float:
        """Return the part that is constant between jumps; at a jump, the value after it."""
        now = time_s + JUMP_TOLERANCE_S
        return self._constant + sum(change for time, change in self._switches if time <= now)

    def smooth_rad_s2(self, time_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Return the part that is smooth: sines of time (from 0 on) and of x1 + x2."""
        value = 0.0
        if self._sine_of_sum:
            value += self._sine_of_sum * math.sin(angle_rad + velocity_rad_s)
        if self._cosine_of_sum:
            value += self._cosine_of_sum * math.cos(angle_rad + velocity_rad_s)
        if time_s > 0.0:
            for amplitude, frequency_rad_s in self._sines:
                value += amplitude * math.sin(frequency_rad_s * time_s)
        return value

    def value_rad_s2(self, time_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Return d(t, x): level and smooth part."""
        return self.level_rad_s2(time_s) + self.smooth_rad_s2(time_s, angle_rad, velocity_rad_s)
