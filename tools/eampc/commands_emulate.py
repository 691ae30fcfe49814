"""`eampc emulate`: the plant emulator as a program of its own, options passed through."""

import os
import sys

import typer

from eampc.hil.processes import emulator_command


def register(app: typer.Typer) -> None:
    app.command(
        context_settings={
            "allow_extra_args": True,
            "ignore_unknown_options": True,
            "help_option_names": [],  # --help, too, is the emulator's
        },
        epilog="Example: eampc emulate rigs/reference --bus socketcan:vcan0",
    )(emulate)


def emulate(context: typer.Context) -> None:
    """Stand in for a rig on a bus.

    The options are those of python -m plant_emulator.
    """
    command = [*emulator_command(), *context.args]
    sys.stdout.flush()
    os.execv(command[0], command)
