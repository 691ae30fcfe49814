"""One scenario through the real daemon and bus: start, reference, arm, run, disarm, stop, read the
logs.

Times of the run are counted in encoder frames, so that a lock-step run has no wall clock in it: the
daemon is armed at cycle ARM_CYCLE, becomes ACTIVE when the arming ramp is over (scenario time 0),
is disarmed when the scenario's duration is over, and the emulator feeds it until the valves are at
rest again.
"""

import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eampc_rig import Rig
from eampc_rig.fault_catalogue import TimedFault

from eampc.errors import RunFailed
from eampc.hil.assessment import Assessment, assess
from eampc.hil.fault_assessment import (
    FaultVerdict,
    WireFigures,
    fault_demands,
    judge_fault,
    judge_wire,
)
from eampc.hil.fault_plan import PlannedFault, plan_faults
from eampc.hil.processes import (
    Ensemble,
    Process,
    daemon_program,
    emulator_command,
    raise_priority,
)
from eampc.hil.recording import (
    COMMAND_COLUMNS,
    RECORD_COLUMNS,
    TRUTH_COLUMNS,
    Recording,
    read_recording,
)
from eampc.hil.scenario_reference import reference_angle, send_reference
from eampc.operator_client import OperatorClient

# Frames before arming: the estimator settles on the resting joint and the operator's commands are
# in.
REFERENCE_CYCLE, ARM_CYCLE = 10, 20
# Frames after the soft stop, so that its end is in the logs.
REST_S = 0.1
# Slowest lock-step seen: 500 cycles/s in user-mode Linux; a loaded machine gets ten times that.
LOCKSTEP_LIMIT_S_PER_FRAME = 0.02
# Beside the frames' own time, for the emulator's start and end. Chosen far too large: it only has
# to end a run that hangs.
START_LIMIT_S = 120.0
# Below the daemon's default priority; the emulator plays hardware, which is never late.
EMULATOR_PRIORITY = 20
STATUS_INTERVAL_S = 0.3  # between two steps of the progress bar
REPLY_LIMIT_S = 30.0  # chosen too large, as above: only a daemon that hangs takes so long


@dataclass(frozen=True)
class RunSettings:
    """How to run: the rig and its changes as the command line gave them, bus, law and pace."""

    rig_path: Path
    variant: str | None
    overrides: tuple[str, ...]
    emulator_overrides: tuple[str, ...]
    bus_url: str
    lockstep: bool
    law: Path
    lcm_url: str
    faults: tuple[TimedFault, ...] = ()
    plant_bus_url: str | None = None  # where two interfaces share one wire; None: bus_url


@dataclass(frozen=True)
class ScenarioRun:
    """What one scenario gave. truth and record as in recording.py, reference_rad at the truth's
    rows; faults, and of the wire only where faults were asked for.
    """

    name: str
    folder: Path
    assessment: Assessment
    truth: Recording
    record: Recording
    reference_rad: Any
    status: dict[str, Any]
    daemon_memory_MB: float | None
    seconds: float
    faults: tuple[str, ...] = ()
    verdicts: tuple[FaultVerdict, ...] = ()
    wire: WireFigures | None = None


@dataclass(frozen=True)
class Timetable:
    """In encoder frames since the daemon's start."""

    arm: int
    active: int
    disarm: int
    end: int


def timetable(rig: Rig, scenario_name: str) -> Timetable:
    period_s = rig.control.period_s
    active = ARM_CYCLE + rig.safety.arming_periods(period_s)
    disarm = active + round(rig.scenarios[scenario_name].duration_s / period_s)
    # A soft stop is two ramps: to the bias, then to the safe voltage.
    stop = round((2 * rig.safety.soft_stop_ramp_s + REST_S) / period_s)
    return Timetable(ARM_CYCLE, active, disarm, disarm + stop)


def run_scenario(
    rig: Rig,
    scenario_name: str,
    settings: RunSettings,
    folder: Path,
    progress: Callable[[float], None] = lambda fraction: None,
) -> ScenarioRun:
    """Runs the scenario and judges it; `folder` gets the logs. progress: told the fraction done."""
    folder.mkdir(parents=True, exist_ok=True)
    truth_path, record_path = folder / "truth.csv", folder / "record.csv"
    commands_path = folder / "commands.csv"
    for path in (truth_path, record_path, commands_path):
        path.unlink(missing_ok=True)
    times = timetable(rig, scenario_name)
    planned = plan_faults(settings.faults, rig, times.active, settings.lockstep)
    began = time.monotonic()
    # sun_path holds 107 bytes: the socket cannot live in a report folder of any depth.
    socket_folder = Path(tempfile.mkdtemp(prefix="eampc-"))
    try:
        with Ensemble() as ensemble:
            daemon = ensemble.start_daemon(
                _daemon_command(settings, socket_folder / "s", record_path), folder / "eampcd.log"
            )
            with OperatorClient(socket_folder / "s", timeout_s=REPLY_LIMIT_S) as client:
                send_reference(client, rig, scenario_name, REFERENCE_CYCLE)
                client.arm(times.arm)
                client.disarm(times.disarm)
                emulator = ensemble.start(
                    Process(
                        "plant_emulator",
                        [
                            *_emulator_command(settings, scenario_name, times, truth_path),
                            *_fault_arguments(planned, rig, commands_path, daemon.pid),
                        ],
                        folder / "plant_emulator.log",
                    )
                )
                if not settings.lockstep:
                    raise_priority(emulator, EMULATOR_PRIORITY)
                _watch(ensemble, emulator, client, times, _limit_s(rig, settings, times), progress)
                status = client.status()
            memory = daemon.peak_memory_MB()
            daemon.stop()
            if daemon.exit_code() != 0:
                raise daemon.failure()
    finally:
        shutil.rmtree(socket_folder, ignore_errors=True)
    truth = read_recording(truth_path, TRUTH_COLUMNS)
    record = read_recording(record_path, RECORD_COLUMNS)
    # What the daemon did after the emulator was switched off is no part of the run.
    record = record.where(record["cycle"] < times.end)
    if len(record) == 0 or len(truth) == 0:
        raise RunFailed(f"{folder}: the daemon recorded no cycle of the run")
    reference_rad = reference_angle(rig, scenario_name, truth["scenario_time_s"])
    assessment = assess(rig, scenario_name, reference_rad, truth, record, settings.lockstep)
    verdicts, wire = (), None
    if planned:
        commands = read_recording(commands_path, COMMAND_COLUMNS)
        verdicts = tuple(
            judge_fault(rig, fault, record, commands, settings.lockstep) for fault in planned
        )
        wire = judge_wire(rig, commands, [times.arm])
        demands = fault_demands(verdicts, wire, settings.lockstep)
        passed = all(demand.met for demand in demands)
        assessment = replace(assessment, demands=demands, passed=passed)
    return ScenarioRun(
        name=scenario_name,
        folder=folder,
        assessment=assessment,
        truth=truth,
        record=record,
        reference_rad=reference_rad,
        status=status,
        daemon_memory_MB=memory,
        seconds=time.monotonic() - began,
        faults=tuple(fault.described(rig.control.period_s, times.active) for fault in planned),
        verdicts=verdicts,
        wire=wire,
    )


def _daemon_command(settings: RunSettings, socket: Path, record: Path) -> list[str]:
    command = [daemon_program(), "--law", str(settings.law), "--bus", settings.bus_url]
    command += ["--socket", str(socket), "--record", str(record), "--lcm-url", settings.lcm_url]
    command += ["--emulation"]
    return [*command, "--lockstep"] if settings.lockstep else command


def _emulator_command(
    settings: RunSettings, scenario_name: str, times: Timetable, truth: Path
) -> list[str]:
    command = [*emulator_command(), str(settings.rig_path)]
    command += ["--bus", settings.plant_bus_url or settings.bus_url]
    if settings.variant:
        command += ["--variant", settings.variant]
    for override in (*settings.overrides, *settings.emulator_overrides):
        command += ["--set", override]
    command += ["--scenario", scenario_name, "--frames", str(times.end)]
    command += ["--lead-frames", str(times.active), "--lcm-url", settings.lcm_url]
    command += ["--log", str(truth)]
    return [*command, "--lockstep"] if settings.lockstep else command


def _fault_arguments(
    planned: list[PlannedFault], rig: Rig, commands: Path, daemon_pid: int
) -> list[str]:
    if not planned:
        return []
    arguments = ["--command-log", str(commands), "--daemon-pid", str(daemon_pid)]
    # The law's own rig: changes to the emulated one only are no other rig.
    arguments += ["--inputs-crc32", str(rig.inputs_crc32)]
    for fault in planned:
        arguments += ["--fault", fault.emulator_argument]
    return arguments


def _limit_s(rig: Rig, settings: RunSettings, times: Timetable) -> float:
    per_frame = LOCKSTEP_LIMIT_S_PER_FRAME if settings.lockstep else 2 * rig.control.period_s
    return START_LIMIT_S + times.end * per_frame


def _watch(
    ensemble: Ensemble,
    emulator: Process,
    client: OperatorClient,
    times: Timetable,
    limit_s: float,
    progress: Callable[[float], None],
) -> None:
    asked = time.monotonic()
    for _ in ensemble.supervise(emulator, limit_s):
        if time.monotonic() - asked >= STATUS_INTERVAL_S:
            asked = time.monotonic()
            progress(min(1.0, max(0.0, client.status()["cycle"] / times.end)))
    progress(1.0)
