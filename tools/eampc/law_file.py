"""The law file: one MessagePack map with version and checksum around all that the daemon needs.

    {"format": "eampc-law", "version": 3, "crc32": zlib.crc32(payload), "payload": bytes}

The payload is a MessagePack map in which an array is {"shape": [...], "f64": bytes} (or "i32"),
little-endian, row-major. The same payload always gives the same bytes.

The law itself, `law` in the payload:

    piece_gain (n_pieces, np), piece_offset (n_pieces,)   u = gain·p + offset, units of the rig
    active_sets (n_regions, ceil(m/32)) int32             bit j % 32 of word j // 32: row j of the
                                                          problem is active; all critical regions
    evaluator                                             which pieces apply, and how combined:
      kind              "tree" or "flat"
      worst_operations  bound on the operations of an evaluation (daemon/service/law_cost.hpp)
      hyperplanes       (n_planes, np+1): normal, offset; normal·p <= offset is "below"
      root, depth       tree: a code as in node_children; most nodes on a path
      node_planes       (n_nodes, 7) int32, heap order: below plane k follows plane 2k+1, above it
                        2k+2; -1: always below
      node_children     (n_nodes, 8) int32 by the bits of the path (above = 1, first plane most
                        significant): code >= 0 is a node, < 0 the leaf ~code
      leaf_care, leaf_bits  flat: (n_leaves, 2) int32, low and high half of a mask: the first leaf
                        with (above & care) == bits, bit i of above: p is above hyperplane i
      leaf_first        (n_leaves+1,) int32: terms of leaf k are leaf_first[k] .. leaf_first[k+1]-1
      term_first        (n_terms+1,) int32, likewise into term_pieces
      term_pieces       int32. u = max over the leaf's terms of (min over the term's pieces)
      fold              (np,), zeros: none; else where fold·p < 0 the law is -law(-p)

The value is clipped to u_min .. u_max.
"""

from __future__ import annotations

import os
import tempfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from eampc.errors import LawFileError
from eampc.law_arrays import law_tables
from eampc.law_safety import SAFETY_KEYS

FORMAT = "eampc-law"
VERSION = 3
REDESIGN = "design it again with: eampc design RIG -o FILE"

# Section → keys that must be there. Sizes and numbers are checked below.
_SECTIONS: dict[str, tuple[str, ...]] = {
    "rig": (
        "name",
        "description",
        "variant",
        "inputs_sha256",
        "inputs_crc32",
        "eampc_version",
    ),
    "timing": ("period_s", "trigger"),
    "model": (
        "order",
        "A",
        "B",
        "A_star",
        "B_star",
        "D",
        "b",
        "b1",
        "b2",
        "valve_time_constant_s",
    ),
    "estimator": (
        "kind",
        "decay",
        "D_inverse",
        "bias_compensation",
        "low_pass_alpha",
        "as_printed",
        "kalman_state_gain",
        "kalman_disturbance_gain",
    ),
    "law": (
        "formulation",
        "reference_is_parameter",
        "fixed_reference_rad",
        "u_min",
        "u_max",
        "parameter_names",
        "parameter_units",
        "lower",
        "upper",
        "piece_gain",
        "piece_offset",
        "evaluator",
        "active_sets",
        "statistics",
    ),
    "problem": (
        "H",
        "F",
        "f",
        "G",
        "w",
        "S",
        "lower",
        "upper",
        "output_U",
        "output_p",
        "output_offset",
    ),
    "tightening": ("kind", "epsilon"),
    "valve": ("bias_V", "control_gain_V", "min_V", "max_V", "safe_V", "slew_max_V_per_s"),
    "safety": SAFETY_KEYS,
    "bus": (
        "encoder",
        "valve_command",
        "sync",
        "valve_feedback",
        "heartbeat",
        "emergency",
        "e_stop",
        "identity",
    ),
    "telemetry": ("lcm_url", "state_decimation", "reference_by_lcm"),
}
# kMaxParameters of the daemon: its nodes and pieces have this many coefficients.
MOST_PARAMETERS = 8


def encode_law(payload: Mapping[str, Any]) -> bytes:
    """Return the bytes of a law file; arrays in `payload` are float64 or int32."""
    body = msgpack.packb(_packable(payload), use_bin_type=True)
    return msgpack.packb(
        {"format": FORMAT, "version": VERSION, "crc32": zlib.crc32(body), "payload": body},
        use_bin_type=True,
    )


def write_law(path: str | Path, payload: Mapping[str, Any]) -> int:
    """Write a law file and return its size in bytes. The file is complete or not there."""
    path = Path(path)
    data = encode_law(payload)
    try:
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise LawFileError(f"{path}: cannot be written ({error.strerror})") from None
    return len(data)


def read_law(path: str | Path) -> dict[str, Any]:
    """Read and check a law file and return its payload; raises LawFileError, one sentence."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise LawFileError(
            f"{path}: there is no such file; make one with: eampc design RIG -o {path}"
        ) from None
    except OSError as error:
        raise LawFileError(f"{path}: cannot be read ({error.strerror})") from None
    return decode_law(data, str(path))


def decode_law(data: bytes, name: str) -> dict[str, Any]:
    """Check the bytes of a law file and return its payload; `name` stands for it in errors."""
    outer = _unpack(data)
    if not isinstance(outer, dict) or outer.get("format") != FORMAT:
        raise LawFileError(f"{name}: is not a law file, or it is cut short or damaged; {REDESIGN}")
    if outer.get("version") != VERSION:
        raise LawFileError(
            f"{name}: has law-file version {outer.get('version')!r}, but this eampc reads version "
            f"{VERSION}; {REDESIGN}"
        )
    body = outer.get("payload")
    if not isinstance(body, bytes) or outer.get("crc32") != zlib.crc32(body):
        raise LawFileError(f"{name}: is damaged, its checksum does not match; {REDESIGN}")
    raw = _unpack(body)
    try:
        payload = _restored(raw, "payload")
        _check(payload)
    except _DefectError as defect:
        raise LawFileError(f"{name}: {defect}; {REDESIGN}") from None
    return payload


class _DefectError(Exception):
    """What is wrong inside a payload whose checksum is right."""


def _unpack(data: bytes) -> Any:
    try:
        return msgpack.unpackb(data, raw=False, strict_map_key=True)
    except (ValueError, msgpack.UnpackException, RecursionError):
        return None


def _packable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _packable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        kind = "i32" if np.issubdtype(value.dtype, np.integer) else "f64"
        plain = np.ascontiguousarray(value, dtype="<i4" if kind == "i32" else "<f8")
        return {"shape": [int(n) for n in value.shape], kind: plain.tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple):
        return [_packable(item) for item in value]
    return value


def _restored(value: Any, where: str) -> Any:
    if isinstance(value, list):
        return [_restored(item, where) for item in value]
    if not isinstance(value, dict):
        return value
    for kind, dtype in (("f64", "<f8"), ("i32", "<i4")):
        if set(value) == {"shape", kind}:
            return _array(value["shape"], value[kind], dtype, where)
    return {key: _restored(item, f"{where}.{key}") for key, item in value.items()}


def _array(shape: Any, data: Any, dtype: str, where: str) -> np.ndarray:
    item_bytes = np.dtype(dtype).itemsize
    whole = isinstance(shape, list) and all(type(n) is int and n >= 0 for n in shape)
    if not whole or not isinstance(data, bytes):
        raise _DefectError(f"{where} is not an array")
    count = 1
    for n in shape:
        count *= n
    if len(data) != count * item_bytes:
        raise _DefectError(f"{where} does not have as many numbers as its shape {shape} says")
    array = np.frombuffer(data, dtype=dtype).reshape(shape).astype(dtype[1:], copy=True)
    if dtype == "<f8" and not np.isfinite(array).all():
        raise _DefectError(f"{where} holds a number that is not finite")
    return array


def _check(payload: Any) -> None:
    if not isinstance(payload, dict):
        raise _DefectError("its payload is not a map")
    for section, keys in _SECTIONS.items():
        table = payload.get(section)
        if not isinstance(table, dict):
            raise _DefectError(f"section {section} is missing")
        for key in keys:
            if key not in table:
                raise _DefectError(f"{section}.{key} is missing")
    law = payload["law"]
    names = law["parameter_names"]
    if not isinstance(names, list) or not 1 <= len(names) <= MOST_PARAMETERS:
        raise _DefectError(f"law.parameter_names must name 1 to {MOST_PARAMETERS} parameters")
    parameters = len(names)
    if len(law["parameter_units"]) != parameters:
        raise _DefectError("law.parameter_units must have one unit for each parameter")
    for key in ("lower", "upper"):
        _require_shape(law[key], (parameters,), f"law.{key}")
    if not (law["lower"] < law["upper"]).all():
        raise _DefectError("law.lower must be below law.upper")
    if not law["u_min"] < law["u_max"]:
        raise _DefectError("law.u_min must be below law.u_max")
    _check_model(payload)
    _check_problem(payload["problem"], parameters)
    _check_tables(law)
    words = -(-len(payload["problem"]["w"]) // 32)
    regions = law["active_sets"].shape[0] if isinstance(law["active_sets"], np.ndarray) else 0
    _require_integers(law["active_sets"], (regions, words), "law.active_sets")


def _require_shape(array: Any, shape: tuple[int, ...], where: str) -> None:
    if not isinstance(array, np.ndarray) or array.shape != shape:
        raise _DefectError(f"{where} must be an array of shape {list(shape)}")


def _check_model(payload: dict[str, Any]) -> None:
    model, estimator = payload["model"], payload["estimator"]
    n = model["order"]
    if n not in (2, 3):
        raise _DefectError("model.order must be 2 or 3")
    for key, shape in (
        ("A", (n, n)),
        ("B", (n,)),
        ("A_star", (n, n)),
        ("B_star", (n,)),
        ("D", (n, 2)),
    ):
        _require_shape(model[key], shape, f"model.{key}")
    _require_shape(estimator["D_inverse"], (2, 2), "estimator.D_inverse")
    _require_shape(estimator["kalman_state_gain"], (2,), "estimator.kalman_state_gain")
    for section, key in (("timing", "period_s"), ("model", "b"), ("estimator", "decay")):
        value = payload[section][key]
        if not isinstance(value, float) or not 0.0 < value < float("inf"):
            raise _DefectError(f"{section}.{key} must be a positive number")


def _check_problem(problem: dict[str, Any], parameters: int) -> None:
    moves = problem["H"].shape[0] if isinstance(problem["H"], np.ndarray) else 0
    rows = problem["w"].shape[0] if isinstance(problem["w"], np.ndarray) else 0
    for key, shape in (
        ("H", (moves, moves)),
        ("F", (moves, parameters)),
        ("f", (moves,)),
        ("G", (rows, moves)),
        ("w", (rows,)),
        ("S", (rows, parameters)),
        ("lower", (parameters,)),
        ("upper", (parameters,)),
        ("output_U", (moves,)),
        ("output_p", (parameters,)),
    ):
        _require_shape(problem[key], shape, f"problem.{key}")


_EVALUATOR_SHAPES = {
    "node_planes": 7,
    "node_children": 8,
    "leaf_care": 2,
    "leaf_bits": 2,
    "leaf_first": None,
    "term_first": None,
    "term_pieces": None,
}


def _check_tables(law: dict[str, Any]) -> None:
    evaluator = law["evaluator"]
    if not isinstance(evaluator, dict):
        raise _DefectError("law.evaluator is missing")
    keys = {"kind", "worst_operations", "hyperplanes", "root", "depth", "fold", *_EVALUATOR_SHAPES}
    if missing := keys - set(evaluator):
        raise _DefectError(f"law.evaluator.{min(missing)} is missing")
    if unknown := set(evaluator) - keys:
        raise _DefectError(f"law.evaluator.{min(unknown)} is not a known key")
    parameters = len(law["parameter_names"])
    pieces = _rows(law["piece_gain"])
    _require_shape(law["piece_gain"], (pieces, parameters), "law.piece_gain")
    _require_shape(law["piece_offset"], (pieces,), "law.piece_offset")
    planes = evaluator["hyperplanes"]
    _require_shape(planes, (_rows(planes), parameters + 1), "law.evaluator.hyperplanes")
    _require_shape(evaluator["fold"], (parameters,), "law.evaluator.fold")
    for key, columns in _EVALUATOR_SHAPES.items():
        rows = _rows(evaluator[key])
        shape = (rows,) if columns is None else (rows, columns)
        _require_integers(evaluator[key], shape, f"law.evaluator.{key}")
    for key in ("root", "depth", "worst_operations"):
        largest = 2**63 if key == "worst_operations" else 2**31
        if type(evaluator[key]) is not int or not -(2**31) <= evaluator[key] < largest:
            raise _DefectError(f"law.evaluator.{key} must be a whole number")
    try:
        counted = law_tables(law).worst_operations
    except (ValueError, TypeError) as error:
        raise _DefectError(f"law.{str(error).splitlines()[0]}") from None
    if counted != evaluator["worst_operations"]:
        raise _DefectError(
            f"law.evaluator.worst_operations is {evaluator['worst_operations']}, but an evaluation "
            f"takes up to {counted}"
        )


def _rows(array: Any) -> int:
    return array.shape[0] if isinstance(array, np.ndarray) and array.ndim else 0


def _require_integers(array: Any, shape: tuple[int, ...], where: str) -> None:
    _require_shape(array, shape, where)
    if array.dtype != np.dtype("i4"):
        raise _DefectError(f"{where} must hold whole numbers")
