"""Operator commands to a running daemon: arm, disarm, reset, status, reference."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eampc.operator_client import OperatorClient

if TYPE_CHECKING:
    from rich.table import Table

SocketOption = Annotated[
    Path | None,
    typer.Option(
        "--socket",
        metavar="PATH",
        help="The daemon's socket. Default: $EAMPC_SOCKET, else $XDG_RUNTIME_DIR/eampcd.sock, "
        "else /tmp/eampcd-UID.sock.",
    ),
]
AtCycleOption = Annotated[
    int | None,
    typer.Option(
        "--at-cycle",
        min=0,
        metavar="N",
        help="Do it in cycle N (encoder frames since the daemon's start) instead of now.",
    ),
]
StartOption = Annotated[
    float | None,
    typer.Option(
        "--start-s",
        min=0.0,
        help="Scenario time (s since ACTIVE) at which it begins. Default: now.",
    ),
]
OffsetOption = Annotated[float, typer.Option("--offset-rad", help="Angle it starts from, rad.")]

reference_app = typer.Typer(
    help="Give the daemon a new reference.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="Example: eampc reference sine --amplitude-rad 0.5 --frequency-hz 0.5",
)


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc arm")(arm)
    app.command(epilog="Example: eampc disarm")(disarm)
    app.command(epilog="Example: eampc reset && eampc arm")(reset)
    app.command(epilog="Example: eampc status --json")(status)
    app.command(epilog="Example: eampc plot $(eampc flight)")(flight)
    app.add_typer(reference_app, name="reference")


def arm(socket: SocketOption = None, at_cycle: AtCycleOption = None) -> None:
    """Let the law move the joint.

    Both valves ramp to their bias first (safety.arming_ramp_s).
    """
    with OperatorClient(socket) as client:
        _tell(client.arm(at_cycle))


def disarm(socket: SocketOption = None, at_cycle: AtCycleOption = None) -> None:
    """Soft stop, then safe voltage.

    Both valves ramp to their bias, then to their safe voltage (safety.soft_stop_ramp_s each).
    """
    with OperatorClient(socket) as client:
        _tell(client.disarm(at_cycle))


def reset(socket: SocketOption = None) -> None:
    """Acknowledge a latched fault.

    The daemon is DISARMED afterwards.
    """
    with OperatorClient(socket) as client:
        _tell(client.reset())


def status(
    socket: SocketOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the reply as JSON.")] = False,
) -> None:
    """Show mode, fault, joint and counters."""
    with OperatorClient(socket) as client:
        reply = client.status()
    if as_json:
        typer.echo(json.dumps(reply, default=str))
        return
    from eampc.terminal import output_console

    output_console().print(_status_table(reply))


def flight(socket: SocketOption = None) -> None:
    """Have the daemon write its last cycles to a file.

    Prints the file's path; a fault writes one by itself. `eampc plot` draws it.
    """
    with OperatorClient(socket) as client:
        _tell(client.command("flight"))


@reference_app.command(epilog="Example: eampc reference constant --amplitude-rad 0.3")
def constant(
    amplitude_rad: Annotated[float, typer.Option("--amplitude-rad", help="The angle, rad.")],
    socket: SocketOption = None,
) -> None:
    """A constant angle."""
    with OperatorClient(socket) as client:
        _tell(client.reference("constant", amplitude_rad=amplitude_rad))


@reference_app.command(epilog="Example: eampc reference step --amplitude-rad 0.5 --start-s 0.5")
def step(
    amplitude_rad: Annotated[float, typer.Option("--amplitude-rad", help="Height, rad.")],
    offset_rad: OffsetOption = 0.0,
    start_s: StartOption = None,
    socket: SocketOption = None,
) -> None:
    """A step from the offset to offset + amplitude."""
    with OperatorClient(socket) as client:
        start = _now_s(client) if start_s is None else start_s
        _tell(
            client.reference(
                "step", amplitude_rad=amplitude_rad, offset_rad=offset_rad, start_s=start
            )
        )


@reference_app.command(
    epilog="Example: eampc reference sine --amplitude-rad 0.5 --frequency-hz 0.5"
)
def sine(
    amplitude_rad: Annotated[float, typer.Option("--amplitude-rad", help="Amplitude, rad.")],
    frequency_hz: Annotated[float, typer.Option("--frequency-hz", min=0.0, help="Frequency, Hz.")],
    offset_rad: OffsetOption = 0.0,
    start_s: StartOption = None,
    socket: SocketOption = None,
) -> None:
    """A sine about the offset."""
    with OperatorClient(socket) as client:
        start = _now_s(client) if start_s is None else start_s
        _tell(
            client.reference(
                "sine",
                amplitude_rad=amplitude_rad,
                offset_rad=offset_rad,
                start_s=start,
                frequency_hz=frequency_hz,
            )
        )


@reference_app.command("csv", epilog="Example: eampc reference csv trajectory.csv")
def from_csv(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Columns time_s, angle_rad and, if known, velocity_rad_s, acceleration_rad_s2.",
        ),
    ],
    sample_period_s: Annotated[
        float,
        typer.Option("--sample-period-s", min=1e-4, max=1.0, help="Grid that it is sampled on, s."),
    ] = 0.005,
    start_s: StartOption = None,
    socket: SocketOption = None,
) -> None:
    """A trajectory from a CSV file.

    After its last row the last angle is held.
    """
    from eampc.reference_table import load_reference_table

    table = load_reference_table(file, sample_period_s)
    with OperatorClient(socket) as client:
        table = table.delayed(_now_s(client) if start_s is None else start_s)
        _tell(client.reference_table(table))


def _now_s(client: OperatorClient) -> float:
    # Negative before ACTIVE: a reference given then begins with the motion.
    return max(0.0, float(client.status().get("scenario_time_s", 0.0)))


def _tell(reply: dict[str, Any]) -> None:
    typer.echo(reply.get("message") or "done")


def _status_table(reply: dict[str, Any]) -> Table:
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    for name, key, form in (
        ("rig", "rig_name", "{}"),
        ("mode", "mode", "{}"),
        ("fault", "fault", "{}"),
        ("fault number", "fault_number", "{}"),
        ("causes that hold", "present_faults_text", "{}"),
        ("last refusal", "refusal", "{}"),
        ("limits", "limits_text", "{}"),
        ("cycle", "cycle", "{}"),
        ("scenario time, s", "scenario_time_s", "{:.3f}"),
        ("reference, rad", "reference_angle_rad", "{:+.5f}"),
        ("angle, rad", "angle_rad", "{:+.5f}"),
        ("velocity, rad/s", "velocity_rad_s", "{:+.4f}"),
        ("disturbance, rad/s²", "disturbance_rad_s2", "{:+.3f}"),
        ("u1, V", "u1_V", "{:.3f}"),
        ("u2, V", "u2_V", "{:.3f}"),
        ("answer p50, µs", "arrival_to_sent_p50_us", "{:.0f}"),
        ("answer p99, µs", "arrival_to_sent_p99_us", "{:.0f}"),
        ("answer max, µs", "arrival_to_sent_max_us", "{:.0f}"),
        ("real time", "realtime_text", "{}"),
        ("law", "law_sha256", "{:.12}"),
    ):
        if key in reply:
            table.add_row(name, form.format(reply[key]) or "none")
    for name, value in (reply.get("counters") or {}).items():
        text = f"{value:.1f}" if isinstance(value, float) else str(value)
        table.add_row(name.replace("_", " "), text)
    return table
