"""Rig → law: model, sampling, tightening, condensed problem, critical regions, evaluator."""

from __future__ import annotations

import importlib.metadata
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eampc import _core
from eampc.errors import DesignError
from eampc.law import Law
from eampc.law_arrays import active_set_words, tables_payload
from eampc.law_safety import safety_table

if TYPE_CHECKING:
    from eampc_rig import Rig

# Random parameters that must lie in a known region: as many as half a second allows.
_COVERAGE_POINTS = 50_000

# Called now and then with the name of the step, what is done and what is known of the whole
# (0: unknown). An exception in it ends the design.
Progress = Callable[[str, int, int], None]

_JOINT = ("moment_of_inertia_kg_m2", "viscous_damping_N_m_s_rad", "gear_radius_m")
_MUSCLE = (
    "k1_N_per_MPa",
    "k2_N_per_MPa",
    "k3_N_per_MPa",
    "initial_contraction_ratio",
    "initial_length_m",
)
_VALVE = ("pressure_gain_MPa_per_V", "control_gain_V", "bias_V")
_CONTROL = (
    "horizon",
    "control_horizon",
    "weight_angle",
    "weight_velocity",
    "weight_control",
    "weight_control_rate",
)
# Table 2.2's symbols: rig key → constant of Assumption 2.2.
_LIPSCHITZ = {
    "lipschitz_delta_per_s2": "l_delta",
    "lipschitz_time_rad_s3": "l_t",
    "bound_delta_rad_s2": "b_delta",
    "lipschitz_delta_t_per_s3": "l_delta_t",
    "bound_delta_t_rad_s3": "b_delta_t",
    "lipschitz_delta_x_per_rad_s2": "l_delta_x",
    "bound_delta_x_per_s2": "b_delta_x",
}


class Parameter(NamedTuple):
    """One entry of p: its name, unit, and the half-width of its interval about zero."""

    name: str
    unit: str
    maximum: float


def design(rig: Rig, progress: Progress | None = None, certificate: bool = True) -> Law:
    """Design the explicit law of a rig that `load_rig` read; the reference rig takes some 10 s,
    with its proof.

    With `certificate` the law is proved (see `eampc.certificate`), and refused if it cannot be.
    Raises DesignError, one sentence that says what stands in the way and what to change.
    """
    require_rig(rig)
    started = time.perf_counter()
    try:
        return _design(rig, progress or (lambda *_: None), started, certificate)
    except (_core.DesignError, _NoLawError) as error:
        raise DesignError(f"{rig.file}: {error}") from None


def require_rig(rig: object) -> None:
    """TypeError for anything but a rig: a path, say, that was not given to load_rig."""
    from eampc_rig import Rig

    if not isinstance(rig, Rig):
        raise TypeError(f"rig must be what load_rig returned, not {type(rig).__name__}")


class _NoLawError(Exception):
    """A sentence without the file's name."""


def _design(rig: Rig, progress: Progress, started: float, certificate: bool) -> Law:
    model, sampled = _model(rig)
    tightening = _tightening(rig, model)
    parameters = parameter_box(rig)
    condensed = _condensed(rig, sampled, tightening, parameters)
    solution = _regions(rig, condensed, progress)
    tables = _law_tables(solution, condensed, rig.control_max, progress)
    law = {
        **tables_payload(tables),
        "active_sets": active_set_words(solution.regions, len(condensed.w)),
        "statistics": _statistics(solution, tables),
        "certificate": "none",
    }
    payload = _payload(rig, model, sampled, tightening, parameters, condensed, law)
    if certificate:
        payload["law"]["certificate"] = _certificate(Law(payload), progress)
    return Law(payload, design_seconds=time.perf_counter() - started)


def _certificate(law: Law, progress: Progress) -> dict[str, Any]:
    from eampc.certificate import certify

    proofs = certify(law, lambda part, done, of: progress(f"proof of {part}", done, of))
    if not proofs.proved:
        raise _NoLawError(
            f"the law could not be proved: {proofs.failure}; lower control.control_horizon, raise "
            "constraints.stage_step, or look into it with --no-certificate and eampc certify"
        )
    return proofs.figures


def _model(rig: Rig) -> tuple[Any, Any]:
    joint = _core.JointData()
    for section, keys in ((rig.joint, _JOINT), (rig.muscle, _MUSCLE), (rig.valve, _VALVE)):
        for key in keys:
            setattr(joint, key, getattr(section, key))
    joint.valve_time_constant_s = rig.model.valve_time_constant_s or 0.0
    model = _core.joint_model(joint)
    return model, _core.discretise(model.A, model.B, rig.control.period_s)


def _tightening(rig: Rig, model: Any) -> np.ndarray:
    """ε, (horizon + 1, 2) on angle and velocity."""
    settings, horizon, period_s = rig.tightening, rig.control.horizon, rig.control.period_s
    rate_per_s = rig.estimator.adaptation_rate_per_s
    bounds = _core.StateBounds()
    bounds.angle_max_rad = rig.constraints.angle_max_rad
    bounds.velocity_max_rad_s = rig.constraints.velocity_max_rad_s
    bounds.control_max = rig.control_max
    if settings.kind == "none":
        return np.zeros((horizon + 1, 2))
    if settings.kind == "theorem":
        constants = _core.LipschitzConstants()
        for key, symbol in _LIPSCHITZ.items():
            setattr(constants, symbol, getattr(settings, key))
        epsilon = _core.theorem_tightening(
            model.joint_A, model.joint_B, bounds, constants, rate_per_s, period_s, horizon
        )
    else:
        epsilon = _core.componentwise_tightening(
            model.joint_A,
            disturbance_max_rad_s2=settings.disturbance_max_rad_s2,
            disturbance_rate_max_rad_s3=settings.disturbance_rate_max_rad_s3,
            **_estimate_quality(rig),
            period_s=period_s,
            horizon=horizon,
        )
    _core.require_room(epsilon, bounds, settings.kind)
    return epsilon


def _assumptions(rig: Rig) -> dict[str, float]:
    """What the tightening rests on, for those who check it."""
    settings = rig.tightening
    stated = {
        "angle_max_rad": rig.constraints.angle_max_rad,
        "velocity_max_rad_s": rig.constraints.velocity_max_rad_s,
        "control_max": rig.control_max,
        "adaptation_rate_per_s": rig.estimator.adaptation_rate_per_s,
    }
    if settings.kind == "theorem":
        stated |= {symbol: getattr(settings, key) for key, symbol in _LIPSCHITZ.items()}
    elif settings.kind == "componentwise":
        stated |= {
            "disturbance_max_rad_s2": settings.disturbance_max_rad_s2,
            "disturbance_rate_max_rad_s3": settings.disturbance_rate_max_rad_s3,
            **_estimate_quality(rig),
        }
    return {key: float(value) for key, value in stated.items()}


def _estimate_quality(rig: Rig) -> dict[str, float]:
    # (13), (14) settle at e^{−aT} δ; multiplied by e^{aT} nothing is missing. What is held is the
    # mean of d over the last period: at most one period old.
    estimator, period_s = rig.estimator, rig.control.period_s
    biased = estimator.kind == "adaptive" and not estimator.bias_compensation
    bias = -math.expm1(-estimator.adaptation_rate_per_s * period_s) if biased else 0.0
    return {"estimate_age_s": period_s, "estimate_relative_bias": bias}


def parameter_box(rig: Rig) -> list[Parameter]:
    """The entries of p, in order, with the box on which the law is defined."""
    box, limits = rig.parameter_box, rig.constraints
    reference = Parameter("reference", "rad", limits.angle_max_rad)
    if rig.control.formulation == "paper":
        state = [
            Parameter("angle", "rad", limits.angle_max_rad),
            Parameter("velocity", "rad/s", limits.velocity_max_rad_s),
            Parameter("disturbance1", "rad/s", box.disturbance1_max_rad_s),
            Parameter("disturbance2", "rad/s2", box.disturbance2_max_rad_s2),
        ]
        return [*state, reference] if rig.control.reference_is_parameter else state
    error = [
        Parameter("angle_error", "rad", box.angle_error_max_rad),
        Parameter("velocity_error", "rad/s", box.velocity_error_max_rad_s),
    ]
    if rig.model.valve_time_constant_s is not None:
        error.append(Parameter("valve_error", "u", box.valve_error_max))
    return [
        *error,
        Parameter("control_steady", "u", rig.control_max),
        reference,
        Parameter("reference_velocity", "rad/s", box.reference_velocity_max_rad_s),
    ]


def _condensed(rig: Rig, sampled: Any, tightening: np.ndarray, parameters: list[Parameter]) -> Any:
    problem = _core.ControlProblem()
    for key in _CONTROL:
        setattr(problem, key, getattr(rig.control, key))
    problem.angle_max_rad = rig.constraints.angle_max_rad
    problem.velocity_max_rad_s = rig.constraints.velocity_max_rad_s
    problem.control_max = rig.control_max
    problem.stage_step = rig.constraints.stage_step
    # Without a quadratic price the problem is not strictly convex in the slack: no slack at all.
    problem.soft_state_bounds = rig.constraints.slack_quadratic > 0.0
    problem.slack_linear = rig.constraints.slack_linear
    problem.slack_quadratic = rig.constraints.slack_quadratic
    problem.tightening = tightening
    problem.reference_is_parameter = rig.control.reference_is_parameter
    problem.fixed_reference_rad = rig.control.reference_rad or 0.0
    problem.upper = np.array([parameter.maximum for parameter in parameters])
    problem.lower = -problem.upper
    make = _core.paper_problem if rig.control.formulation == "paper" else _core.tracking_problem
    return make(sampled, problem)


def _output(condensed: Any, control_max: float) -> Any:
    return _core.OutputLaw(
        condensed.output_U,
        condensed.output_p,
        condensed.output_offset,
        -control_max,
        control_max,
    )


def _regions(rig: Rig, condensed: Any, progress: Progress) -> Any:
    """All critical regions of the box, those with a saturated control too."""

    def report(explored: int, found: int) -> None:
        progress("critical regions", explored, found)

    problem = {
        name: np.ascontiguousarray(getattr(condensed, name))
        for name in ("H", "F", "f", "G", "w", "S", "lower", "upper")
    }
    try:
        solution = _core.solve_mpqp(
            **problem,
            random_points=_COVERAGE_POINTS,
            progress=report,
        )
    except (ValueError, RuntimeError) as error:
        raise _NoLawError(
            f"the law has no explicit form that could be found ({error}); lower "
            "control.control_horizon or raise constraints.stage_step"
        ) from None
    if solution.has_infeasible_parameters:
        raise _NoLawError(
            "parts of the parameter box have no solution because constraints.slack_quadratic is "
            "0, which makes the state bounds hard; give it a price, or narrow [parameter_box]"
        )
    return solution


def _law_tables(
    solution: Any, condensed: Any, control_max: float, progress: Progress
) -> _core.LawTables:
    def report(nodes: int, _regions_in_cell: int) -> None:
        progress("evaluator", nodes, 0)

    try:
        tables, _ = _core.build_law_tables(
            solution, _output(condensed, control_max), progress=report
        )
    except RuntimeError as error:
        raise _NoLawError(
            f"the regions could not be cut into the cells of an evaluator ({error}); lower "
            "control.control_horizon or raise constraints.stage_step"
        ) from None
    return tables


def _statistics(solution: Any, tables: _core.LawTables) -> dict[str, int]:
    found = solution.statistics
    return {
        "regions": int(found["regions"]),
        "pieces": len(tables.piece_offset),
        "hyperplanes": len(tables.hyperplanes),
        "nodes": len(tables.node_planes),
        "depth": tables.depth,
        "leaves": len(tables.leaf_first) - 1,
        "terms": len(tables.term_first) - 1,
        "rows_before": int(found["rows_given"]),
        "rows_kept": int(found["rows_kept"]),
    }


def _estimator(rig: Rig, model: Any, sampled: Any) -> dict[str, Any]:
    settings, period_s = rig.estimator, rig.control.period_s
    gains = np.zeros(3)
    if settings.kind == "kalman":
        gains = _core.kalman_gains(
            model.joint_A,
            angle_noise_rad=settings.angle_noise_rad or _quantisation_rad(rig),
            disturbance_walk_rad_s2_sqrt_Hz=settings.disturbance_walk_rad_s2_sqrt_Hz,
            velocity_walk_rad_s_sqrt_Hz=settings.velocity_walk_rad_s_sqrt_Hz,
            period_s=period_s,
        )
    return {
        "kind": settings.kind,
        "decay": _core.estimator_decay(settings.adaptation_rate_per_s, period_s),
        "D_inverse": _core.disturbance_inverse(sampled),
        "bias_compensation": settings.bias_compensation,
        "low_pass_alpha": _core.low_pass_alpha(settings.low_pass_hz, period_s),
        "as_printed": settings.as_printed,
        "kalman_state_gain": gains[:2],
        "kalman_disturbance_gain": float(gains[2]),
    }


def _quantisation_rad(rig: Rig) -> float:
    """Standard deviation of one encoder count: uniform over its width, width/√12."""
    from eampc_rig import resolve_frames

    layout = resolve_frames(rig).encoder.signal_layout("angle")
    return abs(layout["factor"]) / math.sqrt(12.0)


def _payload(
    rig: Rig,
    model: Any,
    sampled: Any,
    tightening: np.ndarray,
    parameters: list[Parameter],
    condensed: Any,
    law: dict[str, Any],
) -> dict[str, Any]:
    """The content of the law file. No times, no paths: the same inputs give the same bytes."""
    from eampc_rig import resolve_frames

    control_max = float(rig.control_max)
    paper = rig.control.formulation == "paper"
    return {
        "rig": {
            "name": rig.rig.name,
            "description": rig.rig.description,
            "variant": rig.variant or "",
            "inputs_sha256": rig.inputs_sha256,
            "inputs_crc32": rig.inputs_crc32,
            "eampc_version": importlib.metadata.version("eampc"),
        },
        "timing": {"period_s": rig.control.period_s, "trigger": rig.control.trigger},
        "model": {
            "order": model.order,
            "A": model.A,
            "B": model.B,
            "A_star": sampled.A_star,
            "B_star": sampled.B_star,
            "D": sampled.D,
            "b": model.b,
            "b1": model.b1,
            "b2": model.b2,
            "valve_time_constant_s": model.valve_time_constant_s,
        },
        "estimator": _estimator(rig, model, sampled),
        "law": {
            "formulation": rig.control.formulation,
            "reference_is_parameter": paper and rig.control.reference_is_parameter,
            "fixed_reference_rad": float(rig.control.reference_rad or 0.0) if paper else 0.0,
            "u_min": -control_max,
            "u_max": control_max,
            "parameter_names": [parameter.name for parameter in parameters],
            "parameter_units": [parameter.unit for parameter in parameters],
            "lower": condensed.lower,
            "upper": condensed.upper,
            **law,
        },
        "problem": {
            "H": condensed.H,
            "F": condensed.F,
            "f": condensed.f,
            "G": condensed.G,
            "w": condensed.w,
            "S": condensed.S,
            "lower": condensed.lower,
            "upper": condensed.upper,
            "output_U": condensed.output_U,
            "output_p": condensed.output_p,
            "output_offset": condensed.output_offset,
        },
        "tightening": {
            "kind": rig.tightening.kind,
            "epsilon": tightening,
            "assumptions": _assumptions(rig),
        },
        "valve": {
            key: float(getattr(rig.valve, key))
            for key in ("bias_V", "control_gain_V", "min_V", "max_V", "safe_V", "slew_max_V_per_s")
        },
        "safety": safety_table(rig),
        "bus": resolve_frames(rig).layout(),
        "telemetry": {
            "lcm_url": rig.telemetry.lcm_url,
            "state_decimation": rig.telemetry.state_decimation,
            "reference_by_lcm": rig.telemetry.reference_by_lcm,
        },
    }
