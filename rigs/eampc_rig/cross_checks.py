"""Values that are allowed one by one but contradict each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eampc_rig.rig_file import Rig
    from eampc_rig.scenario_sections import DisturbanceTerm

# Keys that one choice makes necessary: (section, key of the choice, value, needed keys).
_NEEDED: tuple[tuple[str, str, str, tuple[str, ...]], ...] = (
    (
        "tightening",
        "kind",
        "componentwise",
        ("disturbance_max_rad_s2", "disturbance_rate_max_rad_s3"),
    ),
    (
        "tightening",
        "kind",
        "theorem",
        (
            "lipschitz_delta_per_s2",
            "lipschitz_time_rad_s3",
            "bound_delta_rad_s2",
            "lipschitz_delta_t_per_s3",
            "bound_delta_t_rad_s3",
            "lipschitz_delta_x_per_rad_s2",
            "bound_delta_x_per_s2",
        ),
    ),
)
_BOX_KEYS = {
    "tracking": (
        "angle_error_max_rad",
        "velocity_error_max_rad_s",
        "reference_velocity_max_rad_s",
    ),
    "paper": ("disturbance1_max_rad_s", "disturbance2_max_rad_s2"),
}


def contradictions(rig: Rig) -> list[str]:
    """Return one sentence per contradiction, naming the keys; empty if the rig holds together."""
    return [
        *_valve(rig),
        *_control(rig),
        *_missing_keys(rig),
        *_safety(rig),
        *_emulator(rig),
        *_scenarios(rig),
    ]


def _valve(rig: Rig) -> Iterator[str]:
    v = rig.valve
    if v.min_V >= v.max_V:
        yield f"valve.min_V is {v.min_V} V, but must be less than valve.max_V = {v.max_V} V"
        return
    for key, value in (("bias_V", v.bias_V), ("safe_V", v.safe_V)):
        if not v.min_V <= value <= v.max_V:
            yield (
                f"valve.{key} is {value} V, but must lie between valve.min_V = {v.min_V} V "
                f"and valve.max_V = {v.max_V} V"
            )
            return
    if rig.control_range <= 0.0:
        yield (
            f"valve.bias_V is {v.bias_V} V, at the edge of valve.min_V..max_V, which leaves no "
            "range for the control u; move it inside"
        )
        return
    limit = rig.constraints.control_max
    if limit is not None and limit > rig.control_range * (1.0 + 1e-12):
        yield (
            f"constraints.control_max is {limit}, but valve.bias_V, min_V, max_V and "
            f"control_gain_V only allow |u| up to {rig.control_range:.6g}; lower it or remove it"
        )


def _control(rig: Rig) -> Iterator[str]:
    c = rig.control
    if c.control_horizon > c.horizon:
        yield (
            f"control.control_horizon is {c.control_horizon}, but must be at most "
            f"control.horizon = {c.horizon}"
        )
    if rig.constraints.stage_step > c.horizon:
        yield (
            f"constraints.stage_step is {rig.constraints.stage_step}, but must be at most "
            f"control.horizon = {c.horizon}"
        )
    if c.formulation == "paper" and not c.reference_is_parameter and c.reference_rad is None:
        yield (
            'control.reference_rad is missing (unit rad); control.formulation = "paper" needs the '
            "fixed reference, or control.reference_is_parameter = true"
        )
    if c.reference_rad is not None and abs(c.reference_rad) > rig.constraints.angle_max_rad:
        yield (
            f"control.reference_rad is {c.reference_rad} rad, outside "
            f"constraints.angle_max_rad = {rig.constraints.angle_max_rad} rad"
        )
    if c.trigger == "sync" and rig.bus.sync is None:
        yield 'control.trigger is "sync", but there is no table [bus.sync]; add it'
    nyquist = 0.5 / c.period_s
    if rig.estimator.low_pass_hz >= nyquist:
        yield (
            f"estimator.low_pass_hz is {rig.estimator.low_pass_hz} Hz, but must be less than "
            f"half the sampling rate, {nyquist:.6g} Hz; 0 switches the filter off"
        )
    if rig.estimator.kind == "adaptive" and rig.bus.encoder.velocity_signal is None:
        yield (
            'estimator.kind is "adaptive", which needs bus.encoder.velocity_signal; name one, '
            'or set estimator.kind = "kalman"'
        )


def _missing_keys(rig: Rig) -> Iterator[str]:
    for section, choice, value, keys in _NEEDED:
        table = getattr(rig, section)
        if getattr(table, choice) == value:
            for key in keys:
                if getattr(table, key) is None:
                    yield f'{section}.{key} is missing; {section}.{choice} = "{value}" needs it'
    formulation = rig.control.formulation
    keys = _BOX_KEYS[formulation]
    if formulation == "tracking" and rig.model.valve_time_constant_s is not None:
        keys = (*keys, "valve_error_max")
    for key in keys:
        if getattr(rig.parameter_box, key) is None:
            yield f'parameter_box.{key} is missing; control.formulation = "{formulation}" needs it'


def _safety(rig: Rig) -> Iterator[str]:
    s = rig.safety
    if s.encoder_timeout_s <= rig.control.period_s:
        yield (
            f"safety.encoder_timeout_s is {s.encoder_timeout_s} s, but must be greater than "
            f"control.period_s = {rig.control.period_s} s"
        )
    low, high = s.supply_pressure_min_kPa, s.supply_pressure_max_kPa
    if low is not None and high is not None and low >= high:
        yield (
            f"safety.supply_pressure_min_kPa is {low} kPa, but must be less than "
            f"safety.supply_pressure_max_kPa = {high} kPa"
        )
    feedback = rig.bus.valve_feedback
    watched = low is not None or high is not None
    if watched and (feedback is None or feedback.supply_pressure_signal is None):
        yield (
            "safety.supply_pressure_min_kPa or max_kPa is set, but there is no "
            "bus.valve_feedback.supply_pressure_signal to compare with; name one"
        )
    if s.encoder_status_mask and rig.bus.encoder.status_signal is None:
        yield (
            f"safety.encoder_status_mask is {s.encoder_status_mask}, but there is no "
            "bus.encoder.status_signal to compare with; name one"
        )


def _emulator(rig: Rig) -> Iterator[str]:
    e, c = rig.emulator, rig.constraints
    for key, value, limit_key, limit in (
        ("initial_angle_rad", e.initial_angle_rad, "angle_max_rad", c.angle_max_rad),
        (
            "initial_velocity_rad_s",
            e.initial_velocity_rad_s,
            "velocity_max_rad_s",
            c.velocity_max_rad_s,
        ),
    ):
        if abs(value) > limit:
            yield f"emulator.{key} is {value}, outside constraints.{limit_key} = {limit}"
    if e.valve_timeout_s <= rig.control.period_s:
        yield (
            f"emulator.valve_timeout_s is {e.valve_timeout_s} s, but must be greater than "
            f"control.period_s = {rig.control.period_s} s"
        )


def _scenarios(rig: Rig) -> Iterator[str]:
    yield from _pulses("emulator.disturbance", rig.emulator.disturbance)
    for name, scenario in rig.scenarios.items():
        key = f"scenarios.{name}"
        yield from _pulses(f"{key}.disturbance", scenario.disturbance)
        if scenario.reference.kind == "csv":
            table = rig.folder / scenario.reference.file
            if not table.is_file():
                yield (
                    f'{key}.reference.file names "{scenario.reference.file}", but {table} does '
                    "not exist; put the table there"
                )
        if scenario.tolerance.rms_from_s >= scenario.duration_s:
            yield (
                f"{key}.tolerance.rms_from_s is {scenario.tolerance.rms_from_s} s, but must be "
                f"less than {key}.duration_s = {scenario.duration_s} s"
            )


def _pulses(key: str, terms: tuple[DisturbanceTerm, ...]) -> Iterator[str]:
    for index, term in enumerate(terms):
        if term.kind == "pulse" and term.end_s <= term.start_s:
            yield (
                f"{key}.{index}.end_s is {term.end_s} s, but must be greater than "
                f"{key}.{index}.start_s = {term.start_s} s"
            )
