"""Command line of the plant emulator: exit 0 done, 1 the run failed, 2 bad input."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer
from eampc_rig.bus_url import open_bus, parse_bus_url
from eampc_rig.frames import resolve_frames
from eampc_rig.overrides import parse_override
from eampc_rig.rig_error import RigError
from eampc_rig.rig_file import Rig, load_rig
from eampc_rig.scenario_sections import DisturbanceTerm

from plant_emulator.bus_faults import BusFaults
from plant_emulator.can_interface import CanInterface
from plant_emulator.command_log import CommandLog
from plant_emulator.daemon_process import DaemonProcess
from plant_emulator.emulator_error import EmulatorError
from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import FaultInjector, parse_fault
from plant_emulator.joint_node import JointNode
from plant_emulator.pacing import LockStep, Pacing, RealTime, SyncPaced
from plant_emulator.plant import Plant
from plant_emulator.telemetry import NO_LCM, Telemetry
from plant_emulator.truth_log import TruthLog
from plant_emulator.valve_node import ValveNode

PROGRAM = "plant_emulator"

app = typer.Typer(add_completion=False, rich_markup_mode=None)


@app.command(
    name=PROGRAM,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: eampc emulate rigs/reference --bus udp_multicast:239.74.163.2:43113",
)
def emulate(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="Rig folder, or its rig.toml.")],
    bus: Annotated[
        str, typer.Option(metavar="URL", help="socketcan:vcan0 or udp_multicast:GROUP:PORT.")
    ],
    variant: Annotated[
        str | None, typer.Option(metavar="NAME", help="Variant of the rig file.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change one key of the rig file; repeatable."
        ),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Scenario whose disturbance acts. Default: emulator.disturbance acts.",
        ),
    ] = None,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Step once per answer instead of in real time.")
    ] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Stop after this many encoder frames.")
    ] = None,
    lead_frames: Annotated[
        int, typer.Option(min=0, metavar="N", help="Encoder frames before scenario time zero.")
    ] = 0,
    lcm_url: Annotated[
        str | None,
        typer.Option(metavar="URL|none", help="LCM of EAMPC_PLANT. Default: the rig file's."),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Truth per frame, .csv or .npz.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND@FRAME[:COUNT[:VALUE]]",
            help="drop, delay (VALUE s), duplicate, corrupt (VALUE bit), freeze or stop; or a "
            "fault of eampc hil --fault list.",
        ),
    ] = None,
    command_log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Every command frame received, as CSV.")
    ] = None,
    daemon_pid: Annotated[
        int | None,
        typer.Option(min=2, metavar="PID", help="The daemon, for the fault deadline_overruns."),
    ] = None,
    inputs_crc32: Annotated[
        int | None,
        typer.Option(
            min=0, metavar="N", help="What the identity message says. Default: the rig's."
        ),
    ] = None,
) -> None:
    """Stand in for the rig on a CAN bus: send encoder frames, obey valve commands."""
    loaded = load_rig(rig, variant, dict(parse_override(text) for text in overrides or []))
    faults = FaultInjector([parse_fault(text) for text in fault or []], loaded.control.period_s)
    codecs = resolve_frames(loaded)
    truth = TruthLog(log)
    commands = CommandLog(command_log, codecs.valve_command)
    telemetry = _telemetry(loaded, lcm_url)
    valve_node = ValveNode(
        codecs.valve_command, loaded.valve.safe_V, loaded.emulator.valve_timeout_s
    )
    plant = Plant(loaded, _terms(loaded, scenario), lead_frames)
    encoder = Encoder.from_rig(loaded, codecs)
    node = JointNode(loaded, codecs, plant, encoder, valve_node, faults, commands, inputs_crc32)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    daemon = None if daemon_pid is None else DaemonProcess(daemon_pid)
    link = open_bus(bus)
    bus_faults = BusFaults(faults, _interface(bus))
    try:
        if lockstep:
            pacing, way = LockStep(link, node, stop, bus_faults), "lock-step"
        elif loaded.control.trigger == "sync" and codecs.sync is not None:
            sync_id = (codecs.sync.frame_id, codecs.sync.is_extended)
            pacing = SyncPaced(link, node, stop, bus_faults, sync_id, daemon)
            way = "real time, paced by Sync frames"
        else:
            pacing = RealTime(link, node, stop, bus_faults, daemon)
            way = "real time"
        print(f"{PROGRAM}: rig {loaded.rig.name} on {bus} in {way}", flush=True)
        done = _run(pacing, frames, truth, telemetry)
    finally:
        bus_faults.end()
        link.shutdown()
        _write(truth, commands)
    print(_summary(done, pacing, valve_node), flush=True)


def _run(
    pacing: LockStep | RealTime, frames: int | None, truth: TruthLog, telemetry: Telemetry
) -> int:
    # Collector pauses of some milliseconds would break the grid; a run makes no cycles to collect.
    gc.collect()
    gc.freeze()
    gc.disable()
    frame = 0
    try:
        while frames is None or frame < frames:
            row = pacing.exchange(frame)
            if row is None:
                break
            truth.append(row)
            telemetry.publish(row)
            frame += 1
    finally:
        gc.enable()
    return frame


def _interface(bus: str) -> CanInterface | None:
    address = parse_bus_url(bus)
    return CanInterface(address.channel) if address.transport == "socketcan" else None


def _terms(rig: Rig, scenario: str | None) -> tuple[DisturbanceTerm, ...]:
    return rig.emulator.disturbance if scenario is None else rig.scenario(scenario).disturbance


def _telemetry(rig: Rig, url: str | None) -> Telemetry:
    if url is not None:
        return Telemetry(url, _complain)
    try:
        return Telemetry(rig.telemetry.lcm_url, _complain)
    except RigError as error:  # nobody asked for LCM on this command line: go on without
        _complain(f"no LCM telemetry: {error}")
        return Telemetry(NO_LCM, _complain)


def _write(*logs: TruthLog | CommandLog) -> None:
    try:
        for log in logs:
            log.write()
    except OSError as error:
        raise EmulatorError(f"a log cannot be written: {error.strerror or error}") from None


def _summary(done: int, pacing: Pacing, valve_node: ValveNode) -> str:
    counts, commands = pacing.counts, valve_node.counts
    return (
        f"{PROGRAM}: {done} frames, {counts.overruns} overruns, "
        f"{commands.accepted} commands accepted, {commands.refused} refused, "
        f"{commands.lost} lost, {counts.send_errors} send errors"
    )


def _complain(sentence: str) -> None:
    print(f"{PROGRAM}: {sentence}", file=sys.stderr, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code. Every error is one sentence on stderr."""
    try:
        result = app(args=arguments, prog_name=PROGRAM, standalone_mode=False)
    except RigError as error:
        _complain(str(error))
        return 2
    except EmulatorError as error:
        _complain(str(error))
        return 1
    except Exception as error:
        # Usage errors of Typer's parser, whichever package its parser lives in.
        if not hasattr(error, "format_message"):
            raise
        _complain(f"{error.format_message().rstrip('.')}; see --help")
        return 2
    return int(result or 0)
