"""The closed loop in one process: the daemon's own control cycle against the nonlinear joint.

What `eampc hil` runs on a bus, without bus, processes or wall clock: same law, same frames, same
arming sequence, so the same numbers up to noise and to what only the emulator has (friction,
hysteresis, the valve node's time-out).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from eampc_rig.rig_file import Rig
from numpy.typing import NDArray

from eampc import _core
from eampc.errors import UserError
from eampc.law import Law, load_law
from eampc.law_design import require_rig
from eampc.reference_table import load_reference_table

# As `eampc hil`: the operator arms in this cycle.
ARM_AT_CYCLE = 20

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class SimulationResult:
    """One entry per cycle from the first frame on; scenario_time_s is negative before ACTIVE.

    `true_` and the pressures are the plant's own at the instant of the encoder frame, the others
    what the daemon records. `control` and `valve_control` are in units of u; `region` is -1 where
    the law did not run; `mode`, `fault` and `limits` are the daemon's numbers.
    """

    cycle: IntArray
    scenario_time_s: Array
    reference_angle_rad: Array
    reference_velocity_rad_s: Array
    measured_angle_rad: Array
    angle_rad: Array
    velocity_rad_s: Array
    valve_control: Array
    disturbance_rad_s2: Array
    control: Array
    u1_V: Array
    u2_V: Array
    region: IntArray
    mode: IntArray
    fault: IntArray
    limits: IntArray
    true_angle_rad: Array
    true_velocity_rad_s: Array
    true_disturbance_rad_s2: Array
    true_torque_N_m: Array
    pressure1_kPa: Array
    pressure2_kPa: Array

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which cycles belong to the scenario (time 0 and later)."""
        return self.scenario_time_s >= 0.0

    @property
    def error_rad(self) -> Array:
        """True angle minus reference in the scenario's cycles."""
        return (self.true_angle_rad - self.reference_angle_rad)[self.active]

    def rms_error_rad(self, from_s: float = 0.0) -> float:
        """RMS of `error_rad` from this scenario time on."""
        late = self.scenario_time_s[self.active] >= from_s
        return float(np.sqrt(np.mean(self.error_rad[late] ** 2)))

    def final_error_rad(self, window_s: float = 0.2) -> float:
        """|mean error| over the last `window_s` of the scenario."""
        time = self.scenario_time_s[self.active]
        return float(abs(np.mean(self.error_rad[time > time[-1] - window_s + 1e-9])))


def simulate(
    rig: Rig, law: Law | str | Path, scenario: str, arm_at_cycle: int = ARM_AT_CYCLE
) -> SimulationResult:
    """Run scenario `scenario` of `rig` with `law` (a designed law, or the path of a law file).

    The law may come from other values of the same rig, to see what a model error does: plant and
    scenario are of `rig`, everything that the daemon knows is of the law.

    Raises RigError for an unknown scenario, UserError for the law of another rig or for an emulated
    effect that this plant has not, LawFileError for a law file that cannot be used.
    """
    require_rig(rig)
    if not isinstance(law, Law):
        law = load_law(law)
    run = rig.scenario(scenario)
    require_law_of(rig, law)
    columns = _core.simulate(
        law.checked,
        plant=simulated_plant(rig),
        disturbance=[term.model_dump() for term in run.disturbance],
        duration_s=run.duration_s,
        arm_at_cycle=arm_at_cycle,
        **_reference(rig, scenario),
    )
    return simulation_result(columns)


def simulation_result(columns: dict[str, Array]) -> SimulationResult:
    """The columns of a simulated run by their names."""
    return SimulationResult(
        **{field.name: columns[field.name] for field in fields(SimulationResult)}
    )


def require_law_of(rig: Rig, law: Law) -> None:
    """UserError for the law of another rig, or for what only the emulator's plant has."""
    designed_for = law.payload["rig"]["name"]
    if designed_for != rig.rig.name:
        raise UserError(f"{law!r} was designed for the rig {designed_for}, not {rig.rig.name}")
    _refuse_what_is_not_simulated(rig)


def simulated_plant(rig: Rig) -> dict[str, object]:
    """The `plant` argument of `_core.simulate` and of what else runs the compiled joint."""
    emulator, valve = rig.emulator, rig.valve
    return {
        **rig.joint.model_dump(),
        **rig.emulated_muscle.model_dump(),
        "pressure_gain_MPa_per_V": valve.pressure_gain_MPa_per_V,
        "min_V": valve.min_V,
        "max_V": valve.max_V,
        "safe_V": valve.safe_V,
        "valve_time_constant_s": emulator.valve_time_constant_s or 0.0,
        "initial_angle_rad": emulator.initial_angle_rad,
        "initial_velocity_rad_s": emulator.initial_velocity_rad_s,
        "hold_until_start": emulator.hold_until_start,
        "substeps": emulator.substeps,
        "encoder_noise_rad": emulator.encoder_noise_rad,
        "velocity_noise_rad_s": emulator.velocity_noise_rad_s,
        "seed": emulator.seed,
    }


def _reference(rig: Rig, scenario: str) -> dict[str, object]:
    reference = rig.scenarios[scenario].reference
    if reference.kind != "csv":
        return reference.model_dump()
    table = load_reference_table(rig.folder / reference.file, rig.control.period_s)
    return {
        "kind": "table",
        "table": np.ascontiguousarray(table.rows),
        "sample_period_s": table.sample_period_s,
    }


def _refuse_what_is_not_simulated(rig: Rig) -> None:
    for key, used in (
        ("emulator.coulomb_friction_N_m", rig.emulator.coulomb_friction_N_m > 0.0),
        ("emulator.bouc_wen", rig.emulator.bouc_wen is not None),
    ):
        if used:
            raise UserError(
                f"{rig.file}: {key} is only in the plant emulator; remove it, or run eampc hil"
            )
