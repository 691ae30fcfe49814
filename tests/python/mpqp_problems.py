"""Multiparametric QPs with known difficulties: the published benchmark (p3, p5) and seeded random
ones, degenerate on purpose.
"""

import numpy as np
from eampc.mpqp import Problem
from scipy.linalg import expm


def benchmark(kind: str, horizon: int, u0: float) -> Problem:
    """Track r with an unstable joint: |u| ≤ 4, |x1| ≤ 1.6, |x2| ≤ 8, sampled at 10 ms.

    kind p5: p = (x1, x2, s1, s2, r) in ±(1.6, 8, 1, 5, 1.2); p3: p = (x1, x2, s2), s1 = 0, r = 1.
    """
    period_s, b, b2 = 0.01, 4.96125, -5.0
    A = np.array([[0.0, 1.0], [106.875 * u0 / 2.0, b2]])
    blocks = np.zeros((5, 5))
    blocks[:2, :2], blocks[:2, 2], blocks[:2, 3:] = A, [0.0, b], np.eye(2)
    sampled = expm(blocks * period_s)
    if kind == "p5":
        # x = (θ, θ̇), the disturbance s and the reference as functions of (p, 1).
        state, disturbance = np.eye(2, 6), np.eye(2, 6, 2)
        reference, upper = np.eye(1, 6, 4)[0], np.array([1.6, 8.0, 1.0, 5.0, 1.2])
    else:
        state, disturbance = np.eye(2, 4), np.array([[0.0] * 4, [0.0, 0.0, 1.0, 0.0]])
        reference, upper = np.array([0.0, 0.0, 0.0, 1.0]), np.array([1.6, 8.0, 5.0])
    count = len(upper)
    on_U = np.zeros((2, horizon))
    H, linear = 2 * 0.01 * np.eye(horizon), np.zeros((horizon, count + 1))
    G, S, w = [], [], []
    for i in range(horizon):
        on_U = sampled[:2, :2] @ on_U
        on_U[:, i] += sampled[:2, 2]
        state = sampled[:2, :2] @ state + sampled[:2, 3:] @ disturbance
        H += 200.0 * np.outer(on_U[0], on_U[0])
        linear += 200.0 * np.outer(on_U[0], state[0] - reference)
        for row, limit in ((0, 1.6), (1, 8.0)):
            for sign in (1.0, -1.0):
                G.append(sign * on_U[row])
                S.append(-sign * state[row, :count])
                w.append(limit - sign * state[row, count])
        for sign in (1.0, -1.0):
            G.append(sign * np.eye(horizon)[i])
            S.append(np.zeros(count))
            w.append(4.0)
    return Problem(
        H,
        linear[:, :count],
        linear[:, count],
        np.array(G),
        np.array(w),
        np.array(S),
        -upper,
        upper,
    )
