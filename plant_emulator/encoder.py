"""The joint encoder: noise, then rounding to whole counts of the DBC's signals."""

from __future__ import annotations

import random

from eampc_rig.frames import Frames
from eampc_rig.rig_file import Rig


class Encoder:
    """Resolutions in rad and rad/s per count (None: no velocity signal); noise as σ of a normal
    distribution, drawn from one seeded sequence so that equal runs give equal frames."""

    def __init__(
        self,
        angle_resolution_rad: float,
        velocity_resolution_rad_s: float | None,
        angle_noise_rad: float = 0.0,
        velocity_noise_rad_s: float = 0.0,
        seed: int = 1,
    ) -> None:
        self._angle_step = angle_resolution_rad
        self._velocity_step = velocity_resolution_rad_s
        self._angle_noise = angle_noise_rad
        self._velocity_noise = velocity_noise_rad_s
        self._random = random.Random(seed)

    @classmethod
    def from_rig(cls, rig: Rig, frames: Frames) -> Encoder:
        """Take the noise of [emulator] and one count of the DBC's signals."""
        codec = frames.encoder
        has_velocity = "velocity" in codec.roles
        return cls(
            abs(codec.signal_layout("angle")["factor"]),
            abs(codec.signal_layout("velocity")["factor"]) if has_velocity else None,
            rig.emulator.encoder_noise_rad,
            rig.emulator.velocity_noise_rad_s,
            rig.emulator.seed,
        )

    def measure(self, angle_rad: float, velocity_rad_s: float) -> tuple[float, float]:
        """Return what the encoder says: angle in rad, velocity in rad/s (0 without the signal)."""
        if self._angle_noise > 0.0:
            angle_rad += self._random.gauss(0.0, self._angle_noise)
        angle = round(angle_rad / self._angle_step) * self._angle_step
        if self._velocity_step is None:
            return angle, 0.0
        if self._velocity_noise > 0.0:
            velocity_rad_s += self._random.gauss(0.0, self._velocity_noise)
        return angle, round(velocity_rad_s / self._velocity_step) * self._velocity_step
