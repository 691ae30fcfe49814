"""The law of a law file by its written rules (eampc.law_file), point by point: the slow oracle."""

from typing import Any

import numpy as np


def leaf_at(evaluator: dict[str, Any], p: np.ndarray) -> int:
    """Leaf at one p; -1 if none of a flat evaluator matches."""
    planes = evaluator["hyperplanes"]
    above = ~(planes[:, :-1] @ p <= planes[:, -1])
    if evaluator["kind"] == "flat":
        masks = [
            [int(np.uint32(low)) | int(np.uint32(high)) << 32 for low, high in evaluator[name]]
            for name in ("leaf_care", "leaf_bits")
        ]
        mask = sum(1 << i for i, bit in enumerate(above) if bit)
        found = [
            k for k, (care, bits) in enumerate(zip(*masks, strict=True)) if mask & care == bits
        ]
        return found[0] if found else -1
    code = evaluator["root"]
    for _ in range(evaluator["depth"]):
        if code < 0:
            break
        place, path = 0, 0
        for _ in range(3):
            plane = evaluator["node_planes"][code, place]
            bit = int(plane >= 0 and above[plane])
            place, path = 2 * place + 1 + bit, 2 * path + bit
        code = int(evaluator["node_children"][code, path])
    assert code < 0
    return ~code


def value_at(law: dict[str, Any], p: np.ndarray) -> tuple[float, set[int]]:
    """(u, not clipped; the pieces that have it) at one p."""
    evaluator = law["evaluator"]
    sign = -1.0 if evaluator["fold"] @ p < 0.0 else 1.0
    p = sign * p
    leaf = leaf_at(evaluator, p)
    if leaf < 0:
        return float("nan"), {-1}
    values = law["piece_gain"] @ p + law["piece_offset"]
    first, pieces = evaluator["term_first"], evaluator["term_pieces"]
    terms = range(evaluator["leaf_first"][leaf], evaluator["leaf_first"][leaf + 1])
    lists = [pieces[first[term] : first[term + 1]] for term in terms]
    u = max(values[term].min() for term in lists)
    return sign * u, {int(k) for term in lists for k in term if abs(values[k] - u) < 1e-9}


def values_at(law: dict[str, Any], points: np.ndarray) -> tuple[np.ndarray, list[set[int]]]:
    """value_at every row of points (k, np)."""
    found = [value_at(law, p) for p in points]
    return np.array([u for u, _ in found]), [pieces for _, pieces in found]
