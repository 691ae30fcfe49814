"""What a law is, in tables for a person and as a plain dict for a script."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from eampc.c99_export import single_precision_error
from eampc.law import Law


def law_summary(law: Law) -> dict[str, Any]:
    """Return the law's figures as numbers, texts and lists (for --json)."""
    p = law.payload
    names, units = law.parameter_names, p["law"]["parameter_units"]
    summary: dict[str, Any] = {
        "rig": dict(p["rig"]),
        "timing": dict(p["timing"]),
        "formulation": p["law"]["formulation"],
        "statistics": law.statistics,
        "worst_operations": p["law"]["evaluator"]["worst_operations"],
        "float_export_error": single_precision_error(law),
        "bytes": len(law.to_bytes()),
        "control_min": p["law"]["u_min"],
        "control_max": p["law"]["u_max"],
        "parameters": [
            {"name": name, "unit": unit, "lower": float(low), "upper": float(high)}
            for name, unit, low, high in zip(names, units, law.lower, law.upper, strict=True)
        ],
        "model": _plain(p["model"]),
        "estimator": _plain(p["estimator"]),
        "tightening": {
            "kind": p["tightening"]["kind"],
            "angle_rad": p["tightening"]["epsilon"][:, 0].tolist(),
            "velocity_rad_s": p["tightening"]["epsilon"][:, 1].tolist(),
        },
        "valve": dict(p["valve"]),
        "safety": dict(p["safety"]),
        "bus": p["bus"],
        "telemetry": dict(p["telemetry"]),
    }
    if law.design_seconds is not None:
        summary["seconds"] = round(law.design_seconds, 3)
    return summary


def print_law(law: Law, console: Console) -> None:
    """Print the law for a person."""
    p = law.payload
    rig, model, estimator, valve = p["rig"], p["model"], p["estimator"], p["valve"]
    variant = f", variant {rig['variant']}" if rig["variant"] else ""
    console.print(f"[bold]{rig['name']}[/bold]{variant}: {rig['description']}")
    console.print(_facts(law, model, estimator, valve))
    console.print(_parameters(law))
    console.print(_frames(p["bus"]))


def summary_table(law: Law, path: str, size_bytes: int) -> Table:
    """The short table after a design."""
    s = law.statistics
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    rows = [
        ("law", path),
        ("critical regions", f"{s['regions']} (rows {s['rows_kept']} of {s['rows_before']})"),
        ("distinct pieces", str(s["pieces"])),
        ("evaluator", _evaluator(law)),
        ("size", f"{size_bytes / 1000:.1f} kB"),
    ]
    if law.design_seconds is not None:
        rows.append(("time", f"{law.design_seconds:.1f} s"))
    for row in rows:
        table.add_row(*row)
    return table


def _facts(law: Law, model: Any, estimator: Any, valve: Any) -> Table:
    p, s = law.payload, law.statistics
    epsilon = p["tightening"]["epsilon"]
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    valves = "ideal"
    if model["valve_time_constant_s"] > 0.0:
        valves = f"{1e3 * model['valve_time_constant_s']:g} ms first order"
    low_pass = "no low-pass"
    if estimator["low_pass_alpha"] < 1.0:
        low_pass = f"low-pass factor {estimator['low_pass_alpha']:.4g} per period"
    rows = [
        ("formulation", p["law"]["formulation"]),
        (
            "period",
            f"{1e3 * p['timing']['period_s']:g} ms, triggered by the {p['timing']['trigger']}",
        ),
        (
            "model",
            f"b {model['b']:.6g} rad/s² per u, b1 {model['b1']:.6g} 1/s², "
            f"b2 {model['b2']:.6g} 1/s, valves {valves}",
        ),
        (
            "estimator",
            f"{estimator['kind']}, e^(-aT) {estimator['decay']:.6g}, {low_pass}",
        ),
        (
            "tightening",
            f"{p['tightening']['kind']}, at the last stage {epsilon[-1, 0]:.4g} rad and "
            f"{epsilon[-1, 1]:.4g} rad/s",
        ),
        ("control", f"u in {p['law']['u_min']:.6g} .. {p['law']['u_max']:.6g}"),
        (
            "valves",
            f"{valve['bias_V']:g} V ± {valve['control_gain_V']:g} V·u in {valve['min_V']:g} .. "
            f"{valve['max_V']:g} V, safe at {valve['safe_V']:g} V",
        ),
        (
            "evaluator",
            f"{s['regions']} critical regions, {s['pieces']} pieces; {_evaluator(law)}; "
            f"{len(law.to_bytes()) / 1000:.1f} kB",
        ),
        ("float export", f"within {single_precision_error(law):.1e} of the double law"),
        ("inputs", f"sha256 {p['rig']['inputs_sha256']}"),
        ("made by", f"eampc {p['rig']['eampc_version']}"),
    ]
    for row in rows:
        table.add_row(*row)
    return table


def _evaluator(law: Law) -> str:
    s, evaluator = law.statistics, law.payload["law"]["evaluator"]
    if evaluator["kind"] == "flat":
        form = f"{s['hyperplanes']} hyperplanes at once, {s['leaves']} leaves"
    elif s["nodes"]:
        form = f"{s['nodes']} nodes of 7 hyperplanes, depth {s['depth']}, {s['leaves']} leaves"
    else:
        form = f"one lattice of {s['terms']} terms"
    if evaluator["fold"].any():
        form += " for half of the box, the law is odd"
    return f"{form}, at most {evaluator['worst_operations']} operations"


def _parameters(law: Law) -> Table:
    table = Table(title="Parameter box", title_justify="left")
    table.add_column("parameter")
    table.add_column("unit")
    table.add_column("lower", justify="right")
    table.add_column("upper", justify="right")
    units = law.payload["law"]["parameter_units"]
    for name, unit, low, high in zip(law.parameter_names, units, law.lower, law.upper, strict=True):
        table.add_row(name, unit, f"{low:g}", f"{high:g}")
    return table


def _frames(bus: Any) -> Table:
    table = Table(title="Frames", title_justify="left")
    for heading in ("frame", "id", "bytes", "signals"):
        table.add_column(heading)
    for name, frame in bus.items():
        if frame is None:
            continue
        signals = frame.get("signals") or {"counter": frame.get("counter_signal")}
        texts = [
            f"{role} {layout['start_bit']}|{layout['length']}"
            f"@{'1' if layout['little_endian'] else '0'}{'-' if layout['is_signed'] else '+'} "
            f"({layout['factor']:g},{layout['offset']:g})"
            for role, layout in signals.items()
            if layout
        ]
        if frame.get("crc"):
            texts.append(f"crc in byte {frame['crc']['byte']}")
        suffix = "x" if frame["extended"] else ""
        table.add_row(name, f"0x{frame['id']:03X}{suffix}", str(frame["length"]), "\n".join(texts))
    return table


def _plain(table: Any) -> dict[str, Any]:
    return {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in table.items()
    }
