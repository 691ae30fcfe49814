"""The plant: two valves, two muscles, one joint, its friction and its disturbance; all in SI."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from eampc_rig.rig_file import Rig
from eampc_rig.scenario_sections import DisturbanceTerm

from plant_emulator.antagonistic_joint import AntagonisticJoint
from plant_emulator.disturbance import JUMP_TOLERANCE_S, Disturbance
from plant_emulator.emulator_error import EmulatorError
from plant_emulator.end_stop import at_end_stop
from plant_emulator.friction import Friction
from plant_emulator.integrator import JointState, rk4_step
from plant_emulator.proportional_valve import ProportionalValve

PA_PER_KPA = 1e3


@dataclass(frozen=True, slots=True)
class PlantSnapshot:
    """The plant's truth at one instant."""

    scenario_time_s: float
    angle_rad: float
    velocity_rad_s: float
    disturbance_rad_s2: float
    pressure1_kPa: float
    pressure2_kPa: float
    torque_N_m: float


class Plant:
    """Advances through one period at a time: `begin_frame(k)`, then `advance_to(offset)` up to T.

    Scenario time of frame k is (k − lead_frames) T. With emulator.hold_until_start the joint stays
    at its start while scenario time is negative; the valves work meanwhile.
    """

    def __init__(
        self, rig: Rig, terms: Iterable[DisturbanceTerm] = (), lead_frames: int = 0
    ) -> None:
        """Start at emulator.initial_*, valves at rest at safe_V.

        Raises RigError if emulator.substeps is too small for the friction asked for.
        """
        self._period_s = rig.control.period_s
        self._substep_s = rig.control.period_s / rig.emulator.substeps
        self._lead_frames = lead_frames
        self._hold = rig.emulator.hold_until_start
        self._end_stop_rad = rig.emulator.end_stop_rad
        self._joint = AntagonisticJoint.from_rig(rig.joint, rig.emulated_muscle)
        self._friction = Friction.from_rig(rig.emulator)
        self._friction.check_step(
            rig.joint.moment_of_inertia_kg_m2, self._period_s, rig.emulator.substeps
        )
        self._disturbance = Disturbance(terms)
        self._level = 0.0
        self.valve1 = ProportionalValve.from_rig(rig)
        self.valve2 = ProportionalValve.from_rig(rig)
        self._state: JointState = (
            rig.emulator.initial_angle_rad,
            rig.emulator.initial_velocity_rad_s,
            0.0,
        )
        self._frame = 0
        self.offset_s = 0.0

    @property
    def angle_rad(self) -> float:
        """Joint angle θ."""
        return self._state[0]

    @property
    def velocity_rad_s(self) -> float:
        """Joint speed θ̇."""
        return self._state[1]

    @property
    def scenario_time_s(self) -> float:
        """Scenario time of the present instant; negative before the scenario starts."""
        return (self._frame - self._lead_frames) * self._period_s + self.offset_s

    @property
    def held(self) -> bool:
        """Whether the joint is kept at its start during the present period."""
        return self._hold and self._frame < self._lead_frames

    def begin_frame(self, frame: int) -> None:
        """Go to the beginning of period `frame`; the one before must be at its end."""
        self._frame = frame
        self.offset_s = 0.0

    def command(self, u1_V: float, u2_V: float) -> None:
        """Hold these voltages at the valves from now on."""
        self.valve1.command(u1_V)
        self.valve2.command(u2_V)

    def advance_to(self, offset_s: float) -> None:
        """Integrate (2) to (5) up to `offset_s` after the frame, stopping at disturbance jumps.

        Raises EmulatorError when the state is no longer finite.
        """
        base = (self._frame - self._lead_frames) * self._period_s
        for jump_s in self._disturbance.jumps_s:
            if self.offset_s + JUMP_TOLERANCE_S < jump_s - base < offset_s - JUMP_TOLERANCE_S:
                self._integrate(base, jump_s - base)
        self._integrate(base, offset_s)

    def snapshot(self) -> PlantSnapshot:
        """Return the truth now. A held joint feels no disturbance but the value is still given."""
        angle, velocity, _ = self._state
        p1, p2 = self.valve1.pressure_Pa, self.valve2.pressure_Pa
        time_s = self.scenario_time_s
        return PlantSnapshot(
            scenario_time_s=time_s,
            angle_rad=angle,
            velocity_rad_s=velocity,
            disturbance_rad_s2=self._disturbance.value_rad_s2(time_s, angle, velocity),
            pressure1_kPa=p1 / PA_PER_KPA,
            pressure2_kPa=p2 / PA_PER_KPA,
            torque_N_m=self._joint.muscle_torque_N_m(angle, p1, p2),
        )

    def _integrate(self, base_s: float, offset_s: float) -> None:
        duration = offset_s - self.offset_s
        if duration <= 0.0:
            return
        # A whole period takes exactly emulator.substeps steps; a part of it no longer ones.
        count = max(1, math.ceil(duration / self._substep_s - 1e-6))
        step = duration / count
        begin = base_s + self.offset_s
        self._level = self._disturbance.level_rad_s2(begin)
        held = self.held
        valve1, valve2 = self.valve1, self.valve2
        state = self._state
        for index in range(count):
            mid1, mid2 = valve1.after(0.5 * step), valve2.after(0.5 * step)
            end1, end2 = valve1.after(step), valve2.after(step)
            if not held:
                pressures = (valve1.pressure_Pa, valve2.pressure_Pa, mid1, mid2, end1, end2)
                state = rk4_step(self._rates, begin + index * step, step, state, pressures)
                state = at_end_stop(state, self._end_stop_rad)
            valve1.pressure_Pa, valve2.pressure_Pa = end1, end2
        if not (math.isfinite(state[0]) and math.isfinite(state[1])):
            raise EmulatorError(
                f"the plant's state is no longer finite at {self.scenario_time_s:.3f} s of "
                "scenario time; raise emulator.substeps, or the loop is unstable"
            )
        self._state = state
        self.offset_s = offset_s

    def _rates(
        self, time_s: float, angle: float, velocity: float, z: float, p1_Pa: float, p2_Pa: float
    ) -> tuple[float, float]:
        friction = self._friction
        disturbance = self._level + self._disturbance.smooth_rad_s2(time_s, angle, velocity)
        acceleration = self._joint.acceleration_rad_s2(
            angle, velocity, p1_Pa, p2_Pa, friction.torque_N_m(velocity, z), disturbance
        )
        return acceleration, friction.hysteresis_rate_per_s(velocity, z)
