"""A pressure proportional valve, equation (2) with a lag: τ Ṗ = k0 u − P, u held within its range.

The command is held between two frames, so the lag is solved exactly: no stiffness, any τ.
"""

from __future__ import annotations

import math

from eampc_rig.rig_file import Rig

from plant_emulator.muscle_force import PA_PER_MPA


class ProportionalValve:
    """k0 in Pa/V; command cut to [min_V, max_V]; time constant in s, None = ideal (P = k0 u)."""

    def __init__(
        self,
        gain_Pa_per_V: float,
        min_V: float,
        max_V: float,
        time_constant_s: float | None,
        voltage_V: float,
    ) -> None:
        """Start at rest at `voltage_V`."""
        self._gain = gain_Pa_per_V
        self._min_V = min_V
        self._max_V = max_V
        self._time_constant_s = time_constant_s
        self._last_duration_s = 0.0
        self._last_decay = 1.0
        self.voltage_V = 0.0
        self.target_Pa = 0.0
        self.command(voltage_V)
        self.pressure_Pa = self.target_Pa

    @classmethod
    def from_rig(cls, rig: Rig) -> ProportionalValve:
        """Take the numbers of [valve] and emulator.valve_time_constant_s; starts at safe_V."""
        valve = rig.valve
        return cls(
            valve.pressure_gain_MPa_per_V * PA_PER_MPA,
            valve.min_V,
            valve.max_V,
            rig.emulator.valve_time_constant_s,
            valve.safe_V,
        )

    def command(self, voltage_V: float) -> None:
        """Hold `voltage_V`, cut to the valve's range; an ideal valve follows at once."""
        self.voltage_V = min(max(voltage_V, self._min_V), self._max_V)
        self.target_Pa = self._gain * self.voltage_V
        if self._time_constant_s is None:
            self.pressure_Pa = self.target_Pa

    def after(self, duration_s: float) -> float:
        """Return the pressure in Pa `duration_s` from now."""
        if self._time_constant_s is None:
            return self.target_Pa
        if duration_s != self._last_duration_s:
            self._last_duration_s = duration_s
            self._last_decay = math.exp(-duration_s / self._time_constant_s)
        return self.target_Pa + (self.pressure_Pa - self.target_Pa) * self._last_decay
