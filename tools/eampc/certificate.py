"""The certificate of a law: every proof redone from what the law file holds, in compiled code.

Proved: (a) the critical regions tile the parameter box, by their facets; (b) the Karush-Kuhn-Tucker
conditions in every region; (c) continuity across facets; the evaluator gives that law everywhere;
(d) the bound on its operations. Computed: (e) the largest set in which the loop stays within all
bounds; (f) the tightening. How, stands in tools/law_design/*_certificate.hpp.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from eampc import _core
from eampc.law import Law
from eampc.tightening_check import check_tightening

PROVED, NOT_PROVED = "proved", "not proved"
# Called now and then with the name of the part, what is done and of how much. An exception in it
# ends the work.
Progress = Callable[[str, int, int], None]

# Parts of law.certificate, each PROVED or NOT_PROVED.
PARTS = ("optimality", "coverage", "continuity", "evaluator", "cost", "tightening")
_SAMPLES, _SEED = 20_000, 1
# The file's figures and the recomputed ones: counts exactly, others to this part of their size or
# of the limit that they must keep.
_SAME_RELATIVE, _SAME_ABSOLUTE = 1e-3, 1e-9


class Certificate(NamedTuple):
    """`figures` go into the law file as law.certificate: no times, numbers and texts only."""

    proved: bool
    failure: str  # one sentence: the first thing that was not proved; else empty
    figures: dict[str, int | float | str]
    seconds: float


def certify(law: Law, progress: Progress | None = None, threads: int = 0) -> Certificate:
    """Prove a law from its payload alone; `threads` 0: as many as the machine runs at once.

    Raises ValueError, one sentence, for a payload whose data make no sense.
    """
    payload = law.payload
    problem = problem_arguments(payload)
    report = progress or (lambda *_: None)
    compiled, seconds = _core.certify_law(
        **problem, tables=law.tables, threads=threads, progress=report
    )
    operations = law.tables.worst_operations
    stated = payload["law"]["evaluator"]["worst_operations"]
    tightening = check_tightening(payload)
    report("invariant set", 0, 0)
    loop = _core.invariant_set(**problem, **closed_loop(payload), samples=_SAMPLES, seed=_SEED)

    failures = [str(compiled["failure"])]
    if operations != stated:
        failures.append(f"an evaluation takes {operations} operations, the file says {stated}")
    failures.append(tightening.failure)
    verdict = {
        "optimality": compiled["optimal"],
        "coverage": compiled["covered"],
        "continuity": compiled["continuous"],
        "evaluator": compiled["evaluated"],
        "cost": operations == stated,
        "tightening": not tightening.failure,
    }
    own = ("proved", "failure", "optimal", "covered", "continuous", "evaluated")
    figures: dict[str, int | float | str] = {
        "eampc_version": importlib.metadata.version("eampc"),
        **{part: PROVED if verdict[part] else NOT_PROVED for part in PARTS},
        **{key: value for key, value in compiled.items() if key not in own},
        "worst_operations": operations,
        "tightening_kind": tightening.kind,
        "tightening_difference": tightening.difference,
        "tightened_rows": tightening.rows,
        "invariant_statement": loop["statement"],
        "invariant_facets": loop["facets"],
        "invariant_steps": loop["steps"],
        "invariant_box_scaling": loop["box_scaling"],
        "invariant_volume_estimate": loop["volume_fraction"],
        "invariant_samples": loop["samples"],
        "spectral_radius": loop["spectral_radius"],
    }
    failure = next((sentence for sentence in failures if sentence), "")
    return Certificate(all(verdict.values()) and not failure, failure, figures, seconds)


def problem_arguments(payload: Mapping[str, Any]) -> dict[str, Any]:
    """The problem, its output and the active sets, as `_core` takes them."""
    problem, law = payload["problem"], payload["law"]
    arguments: dict[str, Any] = {
        name: np.ascontiguousarray(problem[name], dtype=np.float64)
        for name in ("H", "F", "f", "G", "w", "S", "lower", "upper")
    }
    arguments["output"] = _core.OutputLaw(
        problem["output_U"],
        problem["output_p"],
        float(problem["output_offset"]),
        law["u_min"],
        law["u_max"],
    )
    arguments["active_sets"] = np.ascontiguousarray(law["active_sets"], dtype=np.int32)
    return arguments


def closed_loop(payload: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The nominal loop x⁺ = A x + B (u − o·p) + A_r r + w, p = (x, r), and its state bounds.

    Tracking: x is the error e, and u − u_ss drives it; r = (u_ss, y_r, ẏ_r). Paper: x is the state,
    r = (σ̂1, σ̂2[, y_r]). |w| is what the tightening allows the first predicted stage to be wrong.
    """
    model, law = payload["model"], payload["law"]
    A = np.ascontiguousarray(model["A_star"])
    order, parameters = len(A), len(law["lower"])
    tightening = payload["tightening"]
    limits = tightening.get("assumptions", {})
    angle_max = limits.get("angle_max_rad", payload["safety"]["reference_angle_max_rad"])
    of_parameters = np.zeros((order, parameters - order))
    offset = np.zeros(parameters)
    rows = np.zeros((2, parameters))
    rows[0, 0] = rows[1, 1] = 1.0
    if law["formulation"] == "tracking":
        offset[order] = 1.0
        rows[0, order + 1] = rows[1, order + 2] = 1.0
        velocity_max = limits.get("velocity_max_rad_s", np.inf)
    else:
        of_parameters[:, :2] = model["D"]
        velocity_max = limits.get("velocity_max_rad_s", law["upper"][1])
    bounds = np.array([angle_max, velocity_max])
    stated = np.isfinite(bounds)
    wrong = np.zeros(order)
    wrong[:2] = tightening["epsilon"][1]
    return {
        "A": A,
        "B": np.ascontiguousarray(model["B_star"], dtype=np.float64),
        "A_parameters": of_parameters,
        "input_offset": offset,
        "bound_rows": np.vstack([rows[stated], -rows[stated]]),
        "bounds": np.concatenate([bounds[stated]] * 2),
        "disturbance": wrong,
    }


def difference_from_file(certificate: Certificate, law: Law) -> str:
    """One sentence if the law file's own certificate says something else; else empty."""
    stored = law.payload["law"].get("certificate", "none")
    if not isinstance(stored, Mapping):
        return ""
    for key, value in certificate.figures.items():
        if key not in stored:
            return f"the file's certificate lacks {key}"
        if key != "eampc_version" and not _same(value, stored[key]):
            return f"the file's certificate says {key} = {stored[key]}, the proofs give {value}"
    return ""


def _same(a: float | str, b: object) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return abs(a - b) <= max(_SAME_ABSOLUTE, _SAME_RELATIVE * abs(a)) or (a != a and b != b)
    return a == b
