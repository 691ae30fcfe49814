"""The problems of the benchmark: a published angle-tracking MPC, and the laws of ready rigs.

p5: A = [[0, 1], [b1, −5]], B = (0, 4.96125), T = 10 ms, min Σ 100 (x1_i − r)² + 0.01 u_i², |u| ≤ 4,
|x1| ≤ 1.6, |x2| ≤ 8, a constant disturbance s on ẋ; p = (x1, x2, s1, s2, r). b1 = 106.875 u0/2, so
that u0 = 0 makes A singular. p3: p = (x1, x2, s2) with s1 = 0, r = 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eampc.errors import UserError
from eampc.mpqp import Problem, checked_problem

if TYPE_CHECKING:
    from eampc_rig import Rig

    from eampc.law import Law

Array = NDArray[np.float64]

PERIOD_S, INPUT_GAIN, DAMPING_PER_S, STIFFNESS_PER_S2 = 0.01, 4.96125, 5.0, 106.875
INPUT_MAX, STATE_MAX, WEIGHT_ERROR, WEIGHT_INPUT = 4.0, (1.6, 8.0), 100.0, 0.01
BOX_P5 = (1.6, 8.0, 1.0, 5.0, 1.2)
P3_ENTRIES, P3_FIXED = (0, 1, 3), np.array([0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class BoundedForm:
    """lower_gain p + lower_offset ≤ (U; A U) ≤ upper_gain p + upper_offset: what QP solvers like.

    The first len(upper_offset) − len(A) rows bound U itself.
    """

    A: Array
    lower_gain: Array
    lower_offset: Array
    upper_gain: Array
    upper_offset: Array


@dataclass(frozen=True)
class BenchmarkProblem:
    """A multiparametric QP, its output y = output_U·U + output_p·p + output_offset within
    y_min..y_max, and the loop that it closes."""

    name: str
    problem: Problem
    output_U: Array
    output_p: Array
    output_offset: float
    y_min: float
    y_max: float
    # Rows of `problem` that a row of the bounded form stands for: bounded(kept rows).
    bounded: Callable[[set[int]], BoundedForm]
    # (p, y) → the next parameter of the nominal closed loop; None: no such loop is known.
    successor: Callable[[Array, Array], Array] | None = None
    # Parameters of recorded closed loops, (k, np), in their order, where there is no successor.
    recorded: Array | None = None


def as_given(problem: Problem) -> BoundedForm:
    """All rows one-sided, none taken away."""
    none = np.full(len(problem.w), -np.inf)
    return BoundedForm(problem.G, np.zeros_like(problem.S), none, problem.S, problem.w)


def published_names(pattern: str) -> list[str]:
    """p5_u2_N3-20 → p5_u2_N3 … p5_u2_N20; a single name stays."""
    head, _, last = pattern.rpartition("-")
    stem, _, first = head.rpartition("_N")
    if not (first.isdigit() and last.isdigit()):
        return [pattern]
    return [f"{stem}_N{n}" for n in range(int(first), int(last) + 1)]


def published(name: str) -> BenchmarkProblem:
    """The problem called p5_u2_N10 (p3 or p5, u0 of 0 or 2, horizon)."""
    try:
        kind, bias, horizon = name.split("_")
        u0, N = {"u0": 0.0, "u2": 2.0}[bias], int(horizon.removeprefix("N"))
        if kind not in ("p3", "p5") or not horizon.startswith("N") or not 1 <= N <= 60:
            raise ValueError
    except (ValueError, KeyError):
        raise UserError(
            f"no problem is called {name}; write p5_u2_N10: p3 or p5, u0 or u2, N1 to N60"
        ) from None
    whole = _p5(name, u0, N)
    return whole if kind == "p5" else _restricted(whole)


def _p5(name: str, u0: float, N: int) -> BenchmarkProblem:
    A = np.array([[0.0, 1.0], [STIFFNESS_PER_S2 * u0 / 2.0, -DAMPING_PER_S]])
    transition, integral = _sampled(A)
    step = integral @ np.array([0.0, INPUT_GAIN])
    H = 2.0 * WEIGHT_INPUT * np.eye(N)
    F = np.zeros((N, 5))
    on_u, on_p = np.zeros((2, N)), np.hstack([np.eye(2), np.zeros((2, 3))])
    rows_u, rows_p = [], []
    for i in range(N):
        on_u, on_p = transition @ on_u, transition @ on_p
        on_u[:, i] += step
        on_p[:, 2:4] += integral
        error = on_p[0].copy()
        error[4] -= 1.0
        H += 2.0 * WEIGHT_ERROR * np.outer(on_u[0], on_u[0])
        F += 2.0 * WEIGHT_ERROR * np.outer(on_u[0], error)
        rows_u.append(on_u)
        rows_p.append(on_p)
    state_u, state_p = np.vstack(rows_u), np.vstack(rows_p)
    # Two-sided: U itself, then the states; row 2j of the problem is the upper side of row j.
    two_sided_u = np.vstack([np.eye(N), state_u])
    two_sided_p = np.vstack([np.zeros((N, 5)), state_p])
    bound = np.concatenate([np.full(N, INPUT_MAX), np.tile(STATE_MAX, N)])
    sides = np.array([1.0, -1.0])
    G = (two_sided_u[:, None, :] * sides[None, :, None]).reshape(-1, N)
    S = (-two_sided_p[:, None, :] * sides[None, :, None]).reshape(-1, 5)
    upper = np.array(BOX_P5)
    problem = checked_problem(H, F, np.zeros(N), G, np.repeat(bound, 2), S, (-upper, upper))

    def bounded(kept: set[int]) -> BoundedForm:
        states = [j for j in range(N, 3 * N) if 2 * j in kept or 2 * j + 1 in kept]
        rows = [*range(N), *states]
        gain = -two_sided_p[rows]
        return BoundedForm(two_sided_u[states], gain, -bound[rows], gain, bound[rows])

    def successor(p: Array, y: Array) -> Array:
        x = p[:, :2] @ transition.T + y[:, None] * step + p[:, 2:4] @ integral.T
        return np.hstack([x, p[:, 2:]])

    return BenchmarkProblem(
        name,
        problem,
        np.eye(N)[0],
        np.zeros(5),
        0.0,
        -INPUT_MAX,
        INPUT_MAX,
        bounded,
        successor,
    )


def _restricted(whole: BenchmarkProblem) -> BenchmarkProblem:
    """p = select @ p3 + fixed, put into everything."""
    select = np.eye(5)[:, P3_ENTRIES]
    of = whole.problem
    problem = checked_problem(
        of.H,
        of.F @ select,
        of.f + of.F @ P3_FIXED,
        of.G,
        of.w + of.S @ P3_FIXED,
        of.S @ select,
        (of.lower @ select, of.upper @ select),
    )

    def bounded(kept: set[int]) -> BoundedForm:
        form = whole.bounded(kept)
        return BoundedForm(
            form.A,
            form.lower_gain @ select,
            form.lower_offset + form.lower_gain @ P3_FIXED,
            form.upper_gain @ select,
            form.upper_offset + form.upper_gain @ P3_FIXED,
        )

    def successor(p: Array, y: Array) -> Array:
        assert whole.successor is not None
        return whole.successor(p @ select.T + P3_FIXED, y) @ select

    return replace(
        whole,
        problem=problem,
        output_p=np.zeros(3),
        bounded=bounded,
        successor=successor,
    )


def _sampled(A: Array) -> tuple[Array, Array]:
    """e^{AT} and ∫₀ᵀ e^{Aτ} dτ by their series: ‖A‖T ≈ 1, thirty terms leave 1e-33."""
    power = np.eye(2)
    transition, integral = np.eye(2), PERIOD_S * np.eye(2)
    for k in range(1, 31):
        power = power @ A * (PERIOD_S / k)
        transition = transition + power
        integral = integral + power * (PERIOD_S / (k + 1))
    return transition, integral


def of_rig(rig: Rig, law: Law) -> BenchmarkProblem:
    """The problem that a rig's law solves, with parameters of simulated loops where it tracks."""
    of = law.problem
    problem = Problem(of.H, of.F, of.f, of.G, of.w, of.S, of.lower, of.upper)

    def bounded(kept: set[int]) -> BoundedForm:
        rows = sorted(kept)
        none = np.full(len(rows), -np.inf)
        return BoundedForm(
            of.G[rows], np.zeros((len(rows), len(of.lower))), none, of.S[rows], of.w[rows]
        )

    y_min, y_max = law.control_range
    name = rig.rig.name + (f"_{rig.variant}" if rig.variant else "")
    recorded = _recorded(rig, law) if rig.control.formulation == "tracking" else None
    return BenchmarkProblem(
        name,
        problem,
        np.asarray(of.output_U),
        np.asarray(of.output_p),
        float(of.output_offset),
        y_min,
        y_max,
        bounded,
        recorded=recorded,
    )


def _recorded(rig: Rig, law: Law, trials: int = 12) -> Array:
    """p of every cycle of some random trials of `eampc verify`, clamped onto the box."""
    from eampc.verification import campaign_settings, replay

    model: dict[str, Any] = law.payload["model"]
    settings = campaign_settings(rig)
    parts = []
    for index in range(trials):
        _, run, drawn = replay(rig, law, settings, index)
        active = run.active
        r, r_dot = run.reference_angle_rad[active], run.reference_velocity_rad_s[active]
        omega = 2.0 * np.pi * drawn["reference"]["frequency_hz"]
        r_ddot = -(omega**2) * (r - drawn["reference"]["offset_rad"]) if omega else 0.0 * r
        d = run.disturbance_rad_s2[active]
        u_ss = (r_ddot - model["b1"] * r - model["b2"] * r_dot - d) / model["b"]
        u_ss = np.clip(u_ss, *law.control_range)
        columns = [run.angle_rad[active] - r, run.velocity_rad_s[active] - r_dot]
        if model["order"] == 3:
            columns.append(run.valve_control[active] - u_ss)
        parts.append(np.column_stack([*columns, u_ss, r, r_dot]))
    return np.clip(np.vstack(parts), law.lower, law.upper)
