"""Figures of a closed-loop run as PNG: tracking, error, voltages, disturbance, timing.

Drawn without pyplot's global state, so that several can be made anywhere. Axes carry quantity and
unit.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Okabe and Ito's palette: told apart by every kind of colour vision, and in grey.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#666666"
SIZE_INCH = (9.0, 3.6)
RESOLUTION_DPI = 130


def _nothing() -> Array:
    return np.empty(0)


@dataclass(frozen=True)
class LoopData:
    """Curves of one run; empty arrays where a source was not there. Times in s on one axis.
    A reference is NaN where nothing follows it.

    plant_*: the emulator's truth. cycle_*: the daemon's record. mode_changes: (time, mode) marks.
    """

    title: str
    cycle_time_s: Array = field(default_factory=_nothing)
    cycle_reference_rad: Array = field(default_factory=_nothing)
    cycle_angle_rad: Array = field(default_factory=_nothing)
    cycle_u1_V: Array = field(default_factory=_nothing)
    cycle_u2_V: Array = field(default_factory=_nothing)
    cycle_disturbance_rad_s2: Array = field(default_factory=_nothing)
    arrival_to_wake_us: Array = field(default_factory=_nothing)
    wake_to_decided_us: Array = field(default_factory=_nothing)
    decided_to_sent_us: Array = field(default_factory=_nothing)
    arrival_to_sent_us: Array = field(default_factory=_nothing)
    plant_time_s: Array = field(default_factory=_nothing)
    plant_reference_rad: Array = field(default_factory=_nothing)
    plant_angle_rad: Array = field(default_factory=_nothing)
    plant_disturbance_rad_s2: Array = field(default_factory=_nothing)
    valve_range_V: tuple[float, float] | None = None
    angle_max_rad: float | None = None
    error_window_from_s: float | None = None
    error_limit_rad: float | None = None
    period_s: float | None = None
    mode_changes: list[tuple[float, str]] = field(default_factory=list)
    time_label: str = "time since ACTIVE, s"


def write_figures(data: LoopData, folder: Path) -> list[Path]:
    """One PNG per subject that has data, in the order a reader wants them."""
    references = np.concatenate([data.cycle_reference_rad, data.plant_reference_rad])
    subjects: list[tuple[str, bool, Callable[[Figure, LoopData], None]]] = [
        ("tracking", len(data.cycle_time_s) + len(data.plant_time_s) > 0, _tracking),
        ("error", bool(np.any(np.isfinite(references))), _error),
        ("voltages", len(data.cycle_time_s) > 0, _voltages),
        ("disturbance", len(data.cycle_time_s) + len(data.plant_time_s) > 0, _disturbance),
        ("timing", bool(np.any(data.arrival_to_sent_us > 0.0)), _timing),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, has_data, draw in subjects:
        path = folder / f"{name}.png"
        path.unlink(missing_ok=True)
        if has_data:
            figure = Figure(figsize=SIZE_INCH, dpi=RESOLUTION_DPI, layout="constrained")
            FigureCanvasAgg(figure)
            draw(figure, data)
            figure.savefig(path)
            written.append(path)
    return written


def _axes(figure: Figure, data: LoopData, subject: str, y_label: str) -> Axes:
    axes = figure.add_subplot()
    _dress(axes, f"{data.title}: {subject}", data.time_label, y_label)
    for time_s, mode in data.mode_changes:
        axes.axvline(time_s, color=GREY, linewidth=0.7, linestyle=(0, (1, 3)))
        axes.annotate(
            mode.lower().replace("_", " "),
            (time_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -3),
            textcoords="offset points",
            rotation=90,
            va="top",
            fontsize=7,
            color=GREY,
        )
    return axes


def _dress(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    axes.set_title(title, loc="left", fontsize=11)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.margins(x=0.01)


def _legend(axes: Axes) -> None:
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)


def _limits(axes: Axes, low: float, high: float, text: str) -> None:
    for number, level in enumerate((low, high)):
        axes.axhline(
            level, color=RED, linewidth=1.0, linestyle="--", label=text if number == 0 else None
        )


def _measured(data: LoopData) -> tuple[Array, Array, Array]:
    """(time, reference, angle): the truth if it is there, else the daemon's estimate."""
    if len(data.plant_time_s):
        reference = data.plant_reference_rad
        if len(reference) == 0 and len(data.cycle_time_s):
            reference = np.interp(data.plant_time_s, data.cycle_time_s, data.cycle_reference_rad)
        return data.plant_time_s, reference, data.plant_angle_rad
    return data.cycle_time_s, data.cycle_reference_rad, data.cycle_angle_rad


def _tracking(figure: Figure, data: LoopData) -> None:
    time_s, reference, angle = _measured(data)
    axes = _axes(figure, data, "reference and output", "joint angle, rad")
    axes.plot(time_s, angle, color=BLUE, linewidth=1.8, label=r"output $\theta$")
    if len(reference):
        axes.plot(
            time_s,
            reference,
            color="black",
            linewidth=1.1,
            linestyle="--",
            label=r"reference $\theta_r$",
        )
    if data.angle_max_rad is not None:
        seen = np.nanmax(np.abs(np.concatenate([angle, reference])), initial=0.0)
        if seen > 0.6 * data.angle_max_rad:  # a bound far outside would only flatten the curve
            _limits(axes, -data.angle_max_rad, data.angle_max_rad, "bound on θ")
    _legend(axes)


def _error(figure: Figure, data: LoopData) -> None:
    time_s, reference, angle = _measured(data)
    axes = _axes(figure, data, "error", r"$\theta-\theta_r$, mrad")
    error_mrad = 1e3 * (angle - reference)
    axes.plot(time_s, error_mrad, color=BLUE, linewidth=1.2, label="error")
    axes.axhline(0.0, color="black", linewidth=0.6)
    if data.error_limit_rad is not None:
        limit = 1e3 * data.error_limit_rad
        _limits(axes, -limit, limit, "± RMS tolerance")
    if data.error_window_from_s is not None:
        inside = error_mrad[time_s >= data.error_window_from_s]
        if data.error_window_from_s > 0.0:
            axes.axvspan(time_s[0], data.error_window_from_s, color="#f2f2f2", label="not judged")
        # The window that is judged must be readable; what lies before it may leave the picture.
        largest = max(np.nanmax(np.abs(inside), initial=0.0), 1.5e3 * (data.error_limit_rad or 0.0))
        if largest > 0.0 and np.nanmax(np.abs(error_mrad)) > 1.3 * largest:
            axes.set_ylim(-1.3 * largest, 1.3 * largest)
    _legend(axes)


def _voltages(figure: Figure, data: LoopData) -> None:
    axes = _axes(figure, data, "valve commands", "voltage, V")
    for values, colour, label in (
        (data.cycle_u1_V, BLUE, "u1"),
        (data.cycle_u2_V, ORANGE, "u2"),
    ):
        axes.step(data.cycle_time_s, values, color=colour, linewidth=1.3, where="post", label=label)
    if data.valve_range_V is not None:
        low, high = data.valve_range_V
        sent = np.concatenate([data.cycle_u1_V, data.cycle_u2_V])
        _limits(axes, low, high, "valve range")
        if high - low > 4 * (np.nanmax(sent) - np.nanmin(sent)):
            span = np.nanmax(sent) - np.nanmin(sent)
            axes.set_ylim(np.nanmin(sent) - span, np.nanmax(sent) + span)
    _legend(axes)


def _disturbance(figure: Figure, data: LoopData) -> None:
    axes = _axes(figure, data, "disturbance and its estimate", "acceleration, rad/s²")
    if len(data.plant_time_s):
        axes.plot(
            data.plant_time_s,
            data.plant_disturbance_rad_s2,
            color="black",
            linewidth=1.1,
            linestyle="--",
            label="d (plant)",
            zorder=3,
        )
    if len(data.cycle_time_s):
        axes.plot(
            data.cycle_time_s,
            data.cycle_disturbance_rad_s2,
            color=GREEN,
            linewidth=1.5,
            label="d̂ (daemon)",
        )
    _legend(axes)


def _timing(figure: Figure, data: LoopData) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[3, 2])
    _dress(left, f"{data.title}: time from frame to answer", data.time_label, "time, µs")
    stages = (
        (data.arrival_to_wake_us, "arrival to wake", GREY),
        (data.wake_to_decided_us, "wake to decided", GREEN),
        (data.decided_to_sent_us, "decided to sent", ORANGE),
        (data.arrival_to_sent_us, "arrival to sent", BLUE),
    )
    for values, label, colour in stages:
        if len(values) == len(data.cycle_time_s):
            left.plot(
                data.cycle_time_s, _positive(values), ".", markersize=2, color=colour, label=label
            )
    left.set_yscale("log")
    _plain_numbers(left.yaxis)
    left.legend(loc="lower right", fontsize=7, markerscale=5, framealpha=0.9)
    _latency_tail(right, data)


def _latency_tail(axes: Axes, data: LoopData) -> None:
    total = np.sort(_positive(data.arrival_to_sent_us))
    total = total[np.isfinite(total)]
    rarer = 1.0 - np.arange(len(total)) / len(total)
    _dress(axes, "how often it took longer", "arrival to sent, µs", "fraction of cycles")
    axes.step(total, rarer, color=BLUE, where="post")
    axes.set_xscale("log")
    _plain_numbers(axes.xaxis)
    axes.set_xlim(left=total[0] / 3.0)  # room for the names left of the points
    axes.set_yscale("log")
    for fraction, name in ((0.5, "p50"), (0.99, "p99"), (1.0, "max")):
        value = float(np.quantile(total, fraction))
        axes.plot([value], [max(1.0 - fraction, rarer[-1])], "o", color=RED, markersize=4)
        axes.annotate(
            f"{name} {value:.0f} µs",
            (value, max(1.0 - fraction, rarer[-1])),
            xytext=(-6, -3),
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize=8,
        )
    if data.period_s is not None and total[-1] > 0.2e6 * data.period_s:
        axes.axvline(1e6 * data.period_s, color=RED, linestyle="--", linewidth=1.0)


def _plain_numbers(axis: Axis) -> None:
    """100 instead of 10², and 1 and 3 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _positive(values: Array) -> Array:
    return np.where(values > 0.0, values, np.nan)
