"""Multiparametric QPs with known difficulties: the published benchmark (p3, p5) and seeded random
ones, degenerate on purpose.
"""

from typing import Any

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


def random_problem(seed: int) -> Problem:
    """Degenerate on purpose: integrator chains, dense, or with more rows tight than there are
    inputs; 1 to 3 inputs, 1 to 5 parameters; rows given twice, redundant ones, sums of others, rows
    that bound parameters only, and parts of the box without a solution.
    """
    random = np.random.default_rng(seed)
    kind = _pyramid if seed % 5 == 4 else _chain if seed % 2 == 0 else _dense
    H, F, f, G, w, S, upper = kind(random)
    n, count = F.shape
    for _ in range(4):
        row, other = random.integers(len(w), size=2)
        scale = random.choice([0.5, 2.0, 3.0])
        G.append(scale * G[row])  # the same row, scaled
        S.append(scale * S[row])
        w.append(scale * w[row])
        G.append(G[row])  # redundant
        S.append(S[row])
        w.append(w[row] + random.choice([0.1, 0.5]))
        G.append(G[row] + G[other])  # a sum: implied, and tight together with its parts
        S.append(S[row] + S[other])
        w.append(w[row] + w[other])
    if seed % 3 == 0:
        G.append(np.zeros(n))  # bounds the first parameter only
        S.append(np.eye(1, count)[0])
        w.append(0.9 * upper[0])
    return Problem(H, F, f, np.array(G), np.array(w), np.array(S), -upper, upper)


def _chain(random: np.random.Generator) -> tuple[Any, ...]:
    """x_{i+1} = A x_i + B u_i with states that integrate each other; |u| ≤ 1, |x| ≤ 2.5."""
    states = int(random.integers(1, 4))
    inputs = int(random.integers(1, min(states, 3) + 1))
    horizon = int(random.integers(2, 6 if inputs == 1 else 4)) if inputs < 3 else 2
    A = np.eye(states) + np.diag(0.1 * random.integers(1, 11, states - 1), 1)
    B = np.eye(states)[:, states - inputs :]
    tracked = states < 4 and bool(random.integers(2))  # one more parameter: where to go
    count, n = states + tracked, horizon * inputs
    H = 10.0 ** -random.integers(0, 4) * np.eye(n)
    F, G, S, w = np.zeros((n, count)), [], [], []
    on_u, on_p = np.zeros((states, n)), np.eye(states, count)
    goal = np.zeros((states, count))
    goal[0, -1] = float(tracked)
    for i in range(horizon):
        on_u = A @ on_u
        on_u[:, i * inputs : (i + 1) * inputs] += B
        on_p = A @ on_p
        H = H + on_u.T @ on_u
        F = F + on_u.T @ (on_p - goal)
        for j in range(inputs):
            for sign in (1.0, -1.0):
                G.append(sign * np.eye(n)[i * inputs + j])
                S.append(np.zeros(count))
                w.append(1.0)
        for k in range(states):
            for sign in (1.0, -1.0):
                G.append(sign * on_u[k])
                S.append(-sign * on_p[k])
                w.append(2.5)
    return H, F, np.zeros(n), G, w, S, np.full(count, 3.0)


def _dense(random: np.random.Generator) -> tuple[Any, ...]:
    """Random dense data; a right side that does not always leave room."""
    n, count = int(random.integers(1, 4)), int(random.integers(1, 6))
    m = int(random.integers(2, 9))
    root = random.normal(size=(n, n))
    H = root @ root.T + 0.1 * np.eye(n)
    # Small integers now and then: rows that depend on each other exactly.
    draw = (
        (lambda *shape: random.integers(-2, 3, shape).astype(float))
        if random.integers(2)
        else (lambda *shape: random.normal(size=shape))
    )
    G = [row for row in draw(m, n) if row.any()] or [np.ones(n)]
    S = list(0.5 * draw(len(G), count))
    w = list(1.0 + random.random(len(G)))
    for i in range(n):
        for sign in (1.0, -1.0):
            G.append(sign * np.eye(n)[i])
            S.append(np.zeros(count))
            w.append(3.0)
    return H, draw(n, count), draw(n), G, w, S, np.full(count, 1.5)


def _pyramid(random: np.random.Generator) -> tuple[Any, ...]:
    """Three inputs under a roof of 4 to 6 planes that meet in one point, whatever p is; the cost
    pulls to the top, so more rows are tight than there are inputs on a whole part of the box.
    """
    count, sides = int(random.integers(1, 5)), int(random.integers(4, 7))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    angles = 2.0 * np.pi * (np.arange(sides) + 0.3 * random.random(sides)) / sides
    roof = np.column_stack([np.cos(angles), np.sin(angles), np.ones(sides)])
    top = random.normal(size=(3, count))  # the point moves with p
    G = [*(roof @ turn), *(np.array([[0.0, 0.0, -1.0]]) @ turn)]
    S = [*(roof @ top), np.zeros(count)]
    w = [*np.ones(sides), 4.0]
    F = 2.0 * random.normal(size=(3, count))
    return np.eye(3), F, -2.0 * turn[2], G, w, S, np.full(count, 1.0)
