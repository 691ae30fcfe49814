"""The command line as users meet it: help, exit codes, and one sentence for what is wrong."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUS = "udp_multicast:239.74.163.9:43199"
# A law that is designed in an instant: what is tested here is not how well it controls.
SMALL = [
    *("--set", "control.horizon=10"),
    *("--set", "control.control_horizon=1"),
    *("--set", "constraints.stage_step=10"),
]
Eampc = Callable[..., subprocess.CompletedProcess[str]]

COMMANDS = [
    ["design"],
    ["law"],
    ["law", "show"],
    ["certify"],
    ["export"],
    ["mpqp"],
    ["emulate"],
    ["hil"],
    ["demo"],
    ["arm"],
    ["disarm"],
    ["reset"],
    ["status"],
    ["check"],
    ["reference"],
    ["reference", "constant"],
    ["reference", "step"],
    ["reference", "sine"],
    ["reference", "csv"],
    ["spy"],
    ["plot"],
    ["reproduce"],
    ["verify"],
    ["bench"],
    ["bench", "law"],
    ["bench", "offline"],
]


@pytest.fixture(scope="session")
def small_law(eampc: Eampc, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("law") / "small.law"
    done = eampc("design", "rigs/reference", *SMALL, "-o", path)
    assert done.returncode == 0, done.stderr
    return path


def assert_sentence(done: subprocess.CompletedProcess[str], code: int, *parts: str) -> None:
    """One line on stderr that begins with the program's name and contains the parts."""
    assert done.returncode == code, done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("eampc: ")
    for part in parts:
        assert part in lines[0]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_of_every_command(eampc: Eampc, command: list[str]) -> None:
    done = eampc(*command, "--help")
    assert done.returncode == 0, done.stderr
    assert "Usage:" in done.stdout
    example = "Example: eampc " + " ".join(command)
    assert example in " ".join(done.stdout.split())
    assert "\x1b" not in done.stdout


def test_help_lists_the_commands(eampc: Eampc) -> None:
    text = eampc("--help").stdout
    for command in {words[0] for words in COMMANDS}:
        assert f"\n  {command} " in text
    assert "..." not in text.partition("Commands:")[2], "a summary is too long for its line"


@pytest.mark.parametrize(
    "group", [[], ["bench"], ["law"], ["reference"]], ids=["eampc", "bench", "law", "reference"]
)
def test_no_command_shows_the_help(eampc: Eampc, group: list[str]) -> None:
    """It was once folded into one endless sentence."""
    done = eampc(*group)
    assert done.returncode == 2
    assert done.stderr.startswith("Usage: eampc")
    assert "\nCommands:\n" in done.stderr


def test_operator_commands_start_without_numpy() -> None:
    """`eampc disarm` must not wait for what it does not need."""
    code = "import eampc.command_line, sys; sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_version(eampc: Eampc) -> None:
    done = eampc("--version")
    assert done.returncode == 0
    assert done.stdout.split()[0] == "eampc"


def test_unknown_command_is_a_sentence(eampc: Eampc) -> None:
    assert_sentence(eampc("armm"), 2, "armm", "--help")


def test_missing_argument_is_a_sentence(eampc: Eampc) -> None:
    assert_sentence(eampc("hil"), 2, "RIG", "eampc hil --help")


def test_missing_rig(eampc: Eampc) -> None:
    assert_sentence(eampc("hil", "rigs/none"), 2, "rigs/none: there is no such file")


def test_unknown_key_of_the_rig_file(eampc: Eampc) -> None:
    done = eampc("hil", "rigs/reference", "--set", "control.period_ms=5", "--bus", BUS)
    assert_sentence(done, 2, "control.period_ms", "control.period_s")


def test_bad_rig_file(eampc: Eampc, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "rigs" / "reference", tmp_path / "rig")
    text = (tmp_path / "rig" / "rig.toml").read_text()
    (tmp_path / "rig" / "rig.toml").write_text(text.replace("period_s = 0.005", "period_s = -1"))
    done = eampc("hil", tmp_path / "rig", "--bus", BUS)
    assert_sentence(done, 2, "control.period_s")


def test_signal_that_the_dbc_does_not_have(eampc: Eampc) -> None:
    done = eampc("hil", "rigs/reference", "--set", "bus.encoder.angle_signal=Angle", "--bus", BUS)
    assert_sentence(done, 2, "Angle", "Position")


def test_unknown_scenario(eampc: Eampc) -> None:
    done = eampc("hil", "rigs/reference", "--scenario", "jump", "--bus", BUS)
    assert_sentence(done, 2, "jump", "step, sine, load")


def test_unknown_transport(eampc: Eampc) -> None:
    assert_sentence(eampc("hil", "rigs/reference", "--bus", "serial:tty0"), 2, "serial")


def test_interface_that_does_not_exist(eampc: Eampc, small_law: Path, tmp_path: Path) -> None:
    done = eampc(
        "hil", "rigs/reference", *SMALL, "--law", small_law, "--out", tmp_path,
        "--bus", "socketcan:can77",
    )  # fmt: skip
    assert_sentence(done, 2, "can77")


def test_truncated_law(eampc: Eampc, small_law: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.law"
    cut.write_bytes(small_law.read_bytes()[:-1000])
    done = eampc("hil", "rigs/reference", *SMALL, "--law", cut, "--bus", BUS)
    assert_sentence(done, 2, str(cut), "design")


def test_law_of_another_rig(eampc: Eampc, small_law: Path) -> None:
    done = eampc("hil", "rigs/paper-case1", "--law", small_law, "--bus", BUS)
    assert_sentence(done, 2, "was designed for the rig reference, not paper-case1", "eampc design")


def test_law_of_other_values_of_the_same_rig(eampc: Eampc, small_law: Path) -> None:
    done = eampc("hil", "rigs/reference", "--law", small_law, "--bus", BUS)
    assert_sentence(done, 2, "designed from other values of the rig reference", "eampc design")


def test_law_does_not_depend_on_scenarios_and_tolerances(
    eampc: Eampc, small_law: Path, tmp_path: Path
) -> None:
    """The law is accepted, and the run goes on to the bus, which does not exist."""
    done = eampc(
        "hil", "rigs/reference", *SMALL, "--law", small_law, "--out", tmp_path,
        "--set", "scenarios.step.tolerance.rms_error_max_rad=1", "--bus", "socketcan:can77",
    )  # fmt: skip
    assert_sentence(done, 2, "can77")


def test_lcm_that_cannot_be_reached(eampc: Eampc, small_law: Path, tmp_path: Path) -> None:
    done = eampc(
        "hil", "rigs/reference", *SMALL, "--law", small_law, "--out", tmp_path, "--bus", BUS,
        "--lcm-url", "udpm://1.2.3.4:7667?ttl=0",
    )  # fmt: skip
    assert_sentence(done, 2, "udpm://1.2.3.4:7667")


def test_report_folder_that_cannot_be_made(eampc: Eampc, small_law: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = eampc(
        "hil", "rigs/reference", *SMALL, "--law", small_law, "--bus", BUS,
        "--out", tmp_path / "file" / "report",
    )  # fmt: skip
    assert_sentence(done, 2, "--out", "cannot be made")


@pytest.mark.parametrize("command", [["arm"], ["disarm"], ["reset"], ["status"]], ids=" ".join)
def test_operator_command_without_a_daemon(
    eampc: Eampc, tmp_path: Path, command: list[str]
) -> None:
    done = eampc(*command, "--socket", tmp_path / "none")
    assert_sentence(done, 2, "cannot reach the daemon", "start eampcd")


def test_reference_file_is_checked_before_the_daemon_is_asked(eampc: Eampc, tmp_path: Path) -> None:
    done = eampc("reference", "csv", tmp_path / "none.csv", "--socket", tmp_path / "none")
    assert_sentence(done, 2, "none.csv", "No such file")


def test_plot_of_something_else(eampc: Eampc, tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("not a log")
    assert_sentence(eampc("plot", tmp_path / "notes"), 2, "is not an LCM log", "lcm-logger")


def test_spy_without_a_display(eampc_environment: dict[str, str]) -> None:
    environment = {name: text for name, text in eampc_environment.items() if name != "DISPLAY"}
    done = subprocess.run(
        [sys.executable, "-m", "eampc.command_line", "spy"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert_sentence(done, 2)


def test_emulator_gets_its_options(eampc: Eampc) -> None:
    done = eampc("emulate", "rigs/reference", "--bus", "socketcan:can77")
    assert done.returncode == 2
    assert done.stderr.startswith("plant_emulator: ")
    assert "can77" in done.stderr


def test_reader_that_stops_reading_is_no_error(eampc_environment: dict[str, str]) -> None:
    ours, theirs = socket.socketpair()
    theirs.close()
    done = subprocess.run(
        [sys.executable, "-m", "eampc.command_line", "--help"],
        env=eampc_environment,
        stdout=ours,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )
    ours.close()
    assert "Traceback" not in done.stderr
    assert os.strerror(32) not in done.stderr


def test_ctrl_c_is_a_word_and_130(eampc_environment: dict[str, str], tmp_path: Path) -> None:
    """A design without blocked moves takes minutes: there is time to interrupt it."""
    command = [sys.executable, "-m", "eampc.command_line", "design", "rigs/reference"]
    command += ["--set", "control.control_horizon=30", "-o", str(tmp_path / "never.law")]
    process = subprocess.Popen(
        command, cwd=ROOT, env=eampc_environment, stderr=subprocess.PIPE, text=True
    )
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "eampc: interrupted\n")
