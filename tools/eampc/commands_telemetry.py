"""Telemetry for people: `eampc spy` (lcm-spy with our types), `eampc plot LOG` (figures of an LCM
log or a flight record).
"""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc spy")(spy)
    app.command(
        epilog="Example: eampc plot run.lcmlog --out figures (recorded by: lcm-logger run.lcmlog)"
    )(plot)


def spy(
    lcm_url: Annotated[
        str | None,
        typer.Option("--lcm-url", metavar="URL", help="Default: $LCM_DEFAULT_URL, else LCM's own."),
    ] = None,
) -> None:
    """Watch the telemetry in lcm-spy.

    Double-click a channel to see its values.
    """
    from eampc.spy import spy_command

    command, environment = spy_command(lcm_url)
    sys.stdout.flush()
    os.execve(command[0], command, environment)


def plot(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Log of lcm-logger, or a flight record.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the PNG files. Default: LOG.plots."),
    ] = None,
) -> None:
    """Draw a recorded run as PNG files.

    Tracking, error, voltages, disturbance and timing.
    """
    from eampc.flight_record import is_flight_record, read_flight_record
    from eampc.flight_record import loop_data as flight_data
    from eampc.hil.figures import write_figures
    from eampc.hil.report_folder import make_folder
    from eampc.telemetry_log import loop_data, read_telemetry_log

    if is_flight_record(log):
        record = read_flight_record(log)
        folder = make_folder(out or log.with_name(log.name + ".plots"))
        for path in write_figures(flight_data(record), folder):
            typer.echo(path)
        return
    recorded = read_telemetry_log(log)
    folder = make_folder(out or log.with_name(log.name + ".plots"))
    for path in write_figures(loop_data(recorded), folder):
        typer.echo(path)
    if recorded.undecodable:
        typer.echo(
            f"eampc: {recorded.undecodable} messages of another eampc version were left out",
            err=True,
        )
