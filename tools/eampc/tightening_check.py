"""The tightening in force, recomputed: the amounts ε from the stated assumptions, by other formulae
than the design's, and the bounds that the rows of the problem really hold.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

# The design's quadrature and this one agree to about 1e-5.
_RELATIVE = 1e-3
_POINTS_PER_PERIOD = 200


class TighteningCheck(NamedTuple):
    """What was recomputed; `failure` is empty if it agrees with the file."""

    failure: str
    kind: str
    difference: float  # largest of |ε − recomputed ε|, relative to the largest ε
    rows: int  # state rows of the problem that were recognised
    row_difference: float  # largest of |bound in the row − (bound − ε)|, of the bound
    last_angle_rad: float  # ε at the last stage
    last_velocity_rad_s: float


def check_tightening(payload: Mapping[str, Any]) -> TighteningCheck:
    """Recompute payload["tightening"] and find its bounds in the rows of payload["problem"]."""
    section = payload["tightening"]
    epsilon = np.asarray(section["epsilon"])
    if "assumptions" not in section:
        return TighteningCheck(
            "the file does not state what its tightening assumes; design the law again",
            section["kind"],
            *(math.nan, 0, math.nan),
            *epsilon[-1],
        )
    assumptions = section["assumptions"]
    expected = expected_tightening(payload)
    size = max(float(expected.max()), 1e-300)
    difference = float(np.abs(expected - epsilon).max()) / size
    rows, row_difference = _rows_in_force(payload, assumptions, epsilon)
    failure = ""
    if not difference <= _RELATIVE:
        failure = f"the tightening in the file differs by {difference:.2g} from its assumptions"
    elif not row_difference <= 1e-9:
        failure = "a state row of the problem does not hold the tightened bound"
    elif rows == 0:
        failure = "no row of the problem bounds a state"
    return TighteningCheck(
        failure,
        section["kind"],
        difference if epsilon.any() else 0.0,
        rows,
        row_difference,
        float(epsilon[-1, 0]),
        float(epsilon[-1, 1]),
    )


def expected_tightening(payload: Mapping[str, Any]) -> np.ndarray:
    """ε, (horizon + 1, 2), from the stated assumptions."""
    section = payload["tightening"]
    stages = len(section["epsilon"])
    a = section["assumptions"]
    if section["kind"] == "none":
        return np.zeros((stages, 2))
    period_s = payload["timing"]["period_s"]
    A = np.asarray(payload["model"]["A"])[:2, :2]
    if section["kind"] == "theorem":
        return _theorem(A, payload["model"]["b"], a, period_s, stages)
    return _componentwise(A, a, period_s, stages)


def theorem_bounds(
    A: np.ndarray, b: float, a: Mapping[str, float], period_s: float, horizon: int
) -> tuple[float, float]:
    """γ(T) of Lemma 3.1 with ρ as corrected, and φ at the end of the horizon."""
    x_max = math.hypot(a["angle_max_rad"], a["velocity_max_rad_s"])
    beta = a["l_delta"] * x_max + a["b_delta"]
    corners = itertools.product(
        *((-a[key], a[key]) for key in ("angle_max_rad", "velocity_max_rad_s", "control_max"))
    )
    fastest = max(float(np.linalg.norm(A @ [x1, x2] + [0.0, b * u])) for x1, x2, u in corners)
    rho = a["l_delta_t"] * x_max + a["b_delta_t"]
    rho += (a["l_delta_x"] * x_max + a["b_delta_x"]) * (fastest + beta)
    gamma = 2.0 * rho * period_s + (1.0 - math.exp(-a["adaptation_rate_per_s"] * period_s)) * beta
    growth = float(np.linalg.norm(A, 2)) + a["l_delta"]
    excitation = abs(b) * a["control_max"] + a["b_delta"]
    span_s = horizon * period_s
    phi = a["l_delta"] * (x_max + excitation / growth) * (math.exp(growth * span_s) - 1.0)
    return gamma, phi + a["l_t"] * span_s + gamma


def _theorem(
    A: np.ndarray, b: float, a: Mapping[str, float], period_s: float, stages: int
) -> np.ndarray:
    _, phi = theorem_bounds(A, b, a, period_s, stages - 1)
    l_x = float(np.linalg.norm(A, 2))
    t = period_s * np.arange(stages)
    return np.outer(phi / l_x * (np.exp(l_x * t) - 1.0), np.ones(2))


def _componentwise(
    A: np.ndarray, a: Mapping[str, float], period_s: float, stages: int
) -> np.ndarray:
    # Midpoints: e^{Aτ} (0, 1) at τ = (k + ½)h, φ at s = (k + ½)h.
    h = period_s / _POINTS_PER_PERIOD
    count = (stages - 1) * _POINTS_PER_PERIOD
    half = _exponential(A * h / 2.0)
    step = half @ half
    response = half @ np.array([0.0, 1.0])
    kernel = np.empty((count, 2))
    for k in range(count):
        kernel[k] = np.abs(response)
        response = step @ response
    s = h * (np.arange(count) + 0.5)
    drift = a["disturbance_rate_max_rad_s3"] * (s + a["estimate_age_s"])
    drift += a["estimate_relative_bias"] * a["disturbance_max_rad_s2"]
    phi = np.minimum(drift, 2.0 * a["disturbance_max_rad_s2"])
    epsilon = np.zeros((stages, 2))
    for i in range(1, stages):
        n = i * _POINTS_PER_PERIOD
        epsilon[i] = h * (phi[:n] @ kernel[:n][::-1])
    return epsilon


def _exponential(A: np.ndarray) -> np.ndarray:
    """e^A for a small A, by its series."""
    term = total = np.eye(len(A))
    for k in range(1, 30):
        term = term @ A / k
        total = total + term
    return total


def _rows_in_force(
    payload: Mapping[str, Any], assumptions: Mapping[str, float], epsilon: np.ndarray
) -> tuple[int, float]:
    """Rows −S[:, :n] ∝ ±row j of A*^i bound state j at stage i: their number, and the largest
    distance of their bounds from X − ε.
    """
    problem = payload["problem"]
    A = np.asarray(payload["model"]["A_star"])
    order = len(A)
    limits = (assumptions["angle_max_rad"], assumptions["velocity_max_rad_s"])
    powers = [np.eye(order)]
    for _ in range(1, len(epsilon)):
        powers.append(A @ powers[-1])
    found, worst = 0, 0.0
    for row, w in zip(-np.asarray(problem["S"])[:, :order], problem["w"], strict=True):
        if not row.any() or w <= 0.0:
            continue
        # Powers of A* may have parallel rows: any stage that fits and holds its bound will do.
        differences = []
        for i in range(1, len(epsilon)):
            for j in range(2):
                state = powers[i][j]
                scale = float(row @ state) / float(state @ state)
                misfit = float(np.abs(row - scale * state).max()) / float(np.abs(row).max())
                bound = limits[j] - epsilon[i, j]
                if misfit < 1e-9:
                    differences.append(abs(w / abs(scale) - bound) / bound)
        if differences:
            found += 1
            worst = max(worst, min(differences))
    return found, worst
