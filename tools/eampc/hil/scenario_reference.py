"""A scenario's reference: what the daemon is told, and the same motion as numbers to judge by."""

from pathlib import Path

import numpy as np
from eampc_rig import Rig
from numpy.typing import NDArray

from eampc.operator_client import OperatorClient
from eampc.reference_table import load_reference_table

Array = NDArray[np.float64]


def reference_angle(rig: Rig, scenario_name: str, time_s: Array) -> Array:
    """θ_r in rad at scenario times; before 0 as at 0."""
    reference = rig.scenarios[scenario_name].reference
    time_s = np.maximum(time_s, 0.0)
    if reference.kind == "constant":
        return np.full(len(time_s), reference.amplitude_rad)
    if reference.kind == "csv":
        path = Path(rig.folder) / reference.file
        return load_reference_table(path, rig.control.period_s).at(time_s)[:, 0]
    since_start = time_s - reference.start_s
    # Half a nanosecond: a time that is on the grid must not miss a start that is on it too.
    started = since_start > -0.5e-9
    shape = (
        np.ones(len(time_s))
        if reference.kind == "step"
        else np.sin(2 * np.pi * reference.frequency_hz * since_start)
    )
    return reference.offset_rad + reference.amplitude_rad * np.where(started, shape, 0.0)


def send_reference(client: OperatorClient, rig: Rig, scenario_name: str, at_cycle: int) -> None:
    """Hands the scenario's reference to the daemon; its time is scenario time."""
    reference = rig.scenarios[scenario_name].reference
    if reference.kind == "csv":
        path = Path(rig.folder) / reference.file
        client.reference_table(load_reference_table(path, rig.control.period_s), at_cycle)
        return
    client.reference(
        reference.kind,
        amplitude_rad=reference.amplitude_rad,
        offset_rad=getattr(reference, "offset_rad", 0.0),
        start_s=getattr(reference, "start_s", 0.0),
        frequency_hz=getattr(reference, "frequency_hz", 0.0),
        at_cycle=at_cycle,
    )
