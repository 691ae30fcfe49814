"""What the paper does not print and this comparison had to choose, with the numbers of the rigs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from eampc_rig import resolve_frames

from eampc.reproduce.paper_runs import CaseResult
from eampc.reproduce.paper_tables import in_mrad


def differences(result: CaseResult) -> tuple[str, ...]:
    """What the curves of one case show, and where that is not what the paper says."""
    tracking, printed, min_max = result.tracking, result.printed, result.min_max
    own = result.tracking_rig
    limit = result.rig.constraints.velocity_max_rad_s
    over = [
        name
        for name, curve in (("tracking", tracking), ("paper", printed), ("min-max", min_max))
        if abs(curve.velocity_rad_s).max() > limit
    ]
    points = [
        "The cost of Problem 1 has a price on u², so whoever minimises it stops off y_r where "
        "holding y_r takes an input: EAMPC as printed "
        f"({in_mrad(printed.final_error_rad)} mrad) and, with the same cost, min-max MPC "
        f"({in_mrad(min_max.final_error_rad)} mrad), whose offset has a second cause: it does not "
        "estimate d. The tracking formulation has the same model, horizon, bounds and weights, but "
        f"weighs u − u_ss: {in_mrad(tracking.final_error_rad)} mrad. It also ends in a Riccati "
        f"cost, frees {own.control.control_horizon} moves and bounds the states at every "
        f"{own.constraints.stage_step}th stage.",
        "The paper calls the input of EAMPC smoother and lower than that of min-max MPC. Here all "
        "start at the bound, and in the first second they travel "
        f"Σ|Δu| = {_travels(result, 0.0, 1.0)}; after it {_travels(result, 1.0)}. What EAMPC adds "
        "at rest is the encoder's resolution: one count of velocity within a period is "
        f"{_count_rad_s2(result):.2g} rad/s² of estimated disturbance, which the law answers.",
    ]
    if result.active_set is not None:
        law_s = median(t.estimators_and_law_s for t in result.tracking_times) / result.steps
        points.append(
            "The ratio depends on the solver. The programs of this min-max run, without the search "
            "for the worst vertex and without Python around them, take the active-set solver DAQP "
            f"{1e6 * result.active_set.mean_s:.0f} µs each: "
            f"{result.active_set.mean_s / law_s:,.0f} EAMPC steps. Its u differs from Clarabel's "
            f"by at most {result.active_set.largest_difference:.1g}."
        )
    if over:
        points.append(
            f"The velocity exceeds its bound of {limit:g} rad/s with {' and '.join(over)}: state "
            "bounds are soft, and what lies between the bounded stages is not seen."
        )
    return tuple(points)


def _travels(result: CaseResult, from_s: float, to_s: float = math.inf) -> str:
    return ", ".join(
        f"{curve.control_travel(from_s, to_s):.0f} ({name})"
        for name, curve in (
            ("tracking", result.tracking),
            ("paper", result.printed),
            ("min-max", result.min_max),
        )
    )


def _count_rad_s2(result: CaseResult) -> float:
    """What one count of the velocity signal over one period looks like as an acceleration."""
    velocity = resolve_frames(result.rig).encoder.signal_layout("velocity")
    return abs(velocity["factor"]) / result.rig.control.period_s


def assumptions(results: Sequence[CaseResult]) -> tuple[str, ...]:
    """One sentence or two per choice."""
    rig, problem = results[0].rig, results[0].problem
    joint, control, limits = rig.joint, rig.control, rig.constraints
    bounds = ", ".join(
        f"{result.problem.disturbance_max_rad_s2:g} in case {result.case.number}"
        for result in results
    )
    return (
        f"Not printed, chosen here: J = {joint.moment_of_inertia_kg_m2:g} kg m², b_v = "
        f"{joint.viscous_damping_N_m_s_rad:g} N m s/rad, T = {1e3 * control.period_s:g} ms, N = "
        f"{control.horizon}, Q = {control.weight_angle:g}, R = {control.weight_control:g}, a = "
        f"{rig.estimator.adaptation_rate_per_s:g} /s, |θ| ≤ {limits.angle_max_rad:g} rad, |θ̇| ≤ "
        f"{limits.velocity_max_rad_s:g} rad/s, |u| ≤ {problem.control_max:g}. Nor does the paper "
        "print the constants of Assumption 2.2; the bounds on d and ḋ stand in for them.",
        "k_a of Table I is taken for k_u of (1). Taken literally, with k1 to k3 in N/MPa and k0 in "
        "MPa/V, Table I describes a plant for simulation only: the gear radius is longer than the "
        "muscle, and holding y_r takes negative pressures.",
        "The plant is (9) as written, with d the printed function of the true state, integrated by "
        "ten Runge-Kutta steps per period. The term 2 k1 (rθ/L0)² u, which the paper counts into "
        "d, is left out of it: it would outweigh the stated d.",
        "Both controllers read the same encoder frames (17 bits per turn) and command the same "
        "valve frames (2 mV); valves are ideal.",
        "The discrete model is the integral form, not A⁻¹(e^{AT} − 1): in case 2 u0 = 0 makes A "
        "singular. The output of stage i is C x_i, not C x_{i−1} as in (20).",
        "The gradient and the KKT lines printed for Problem 1 contradict its cost; the law here "
        "solves the problem itself, with both sides of every state bound and with u ∈ U. State "
        "bounds share one slack at an exact penalty, for EAMPC and min-max MPC alike.",
        "EAMPC as printed uses the estimator (13), (14) as printed, whose estimate settles at "
        "e^{−aT} d; the tracking law uses its exact sampled form, compensated.",
        "Min-max MPC is not defined in the paper beyond its name. Here it is the open-loop form, "
        "one input sequence against every disturbance sequence, solved exactly; d is held through "
        f"a period, as u is, and |d| ≤ {bounds} rad/s² is the bound that EAMPC's tightening "
        "assumes too. It knows no bound on ḋ and estimates nothing.",
        "How long the paper's runs last in simulated time, at which period, and how its min-max "
        "problem was solved is not printed (Matlab is). Only ratios compare; seconds do not.",
        "Running time is the controller's alone, from the decoded sample to u, as processor time "
        "of its one thread, so that a busy machine favours neither. EAMPC's steps follow one "
        "another at once, so caches are warm. Designing the law is offline and not counted.",
    )
