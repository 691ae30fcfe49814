"""tools/vcanrun from outside: what a caller sees.

These start the runner themselves and so carry no `vcan` marker. A machine on which no vcan can
be had fails here: that is the finding, not a reason to skip.
"""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUNNER = ROOT / "tools" / "vcanrun"
GUEST_LIMIT_S = 200  # longer than the boot limit of user-mode Linux, so that its own error is seen

pytestmark = pytest.mark.timeout(300)


def run(*arguments, cwd, options=(), env=None):
    return subprocess.run(
        [sys.executable, str(RUNNER), *options, "--", *map(str, arguments)],
        cwd=cwd,
        env=env,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=GUEST_LIMIT_S,
    )


def processes_with(token):
    found = []
    for entry in Path("/proc").iterdir():
        try:
            command_line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (OSError, ValueError):
            continue
        if entry.name.isdigit() and token in command_line:
            found.append(f"{entry.name} {command_line}")
    return found


def wait_for(condition, limit_s):
    end_s = time.monotonic() + limit_s
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.05)
    return condition()


def test_status_outputs_and_working_directory(tmp_path):
    done = run(
        "sh",
        "-c",
        "echo to-stdout; echo to-stderr >&2; pwd -P > written; ip -o link show vcan0; exit 7",
        cwd=tmp_path,
    )

    assert (done.returncode, done.stderr) == (7, "to-stderr\n")
    assert done.stdout.startswith("to-stdout\n")
    assert "vcan0: <NOARP,UP,LOWER_UP" in done.stdout
    assert (tmp_path / "written").read_text().strip() == str(tmp_path.resolve())


def test_arguments_directory_and_environment_survive_the_shells(tmp_path):
    directory = tmp_path / 'it\'s a "dir" $HOME'
    extra = tmp_path / "further dir"
    directory.mkdir()
    extra.mkdir()
    arguments = ["two words", "", "it's", '"', "$HOME `id` \\", "*", "-x", "line\nbreak", "--", "θ̇"]
    value = 'a\'b "c" $d\ne'
    code = (
        "import json, os, pathlib, sys;"
        "pathlib.Path('seen').write_text(json.dumps([sys.argv[2:], os.environ['TEST_VALUE']]));"
        "pathlib.Path(sys.argv[1], 'seen').write_text('also')"
    )

    done = run(
        *(sys.executable, "-c", code, extra, *arguments),
        cwd=directory,
        options=["--rw", str(extra)],
        env={**os.environ, "TEST_VALUE": value},
    )

    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((directory / "seen").read_text()) == [arguments, value]
    assert (extra / "seen").read_text() == "also"


def test_large_outputs_arrive_whole(tmp_path):
    lines = 50_000
    done = run("sh", "-c", f"seq {lines}; seq {lines} >&2", cwd=tmp_path)

    expected = "".join(f"{i}\n" for i in range(1, lines + 1))
    assert done.returncode == 0
    assert done.stdout == expected
    assert done.stderr == expected


def test_time_limit_gives_124_and_keeps_what_was_printed(tmp_path):
    token = f"{time.time_ns() % 10**9 + 10**9}"
    done = run(
        *("sh", "-c", f"echo before; sleep {token}"), cwd=tmp_path, options=["--timeout", "1"]
    )

    assert (done.returncode, done.stdout) == (124, "before\n")
    assert done.stderr == "vcanrun: time limit of 1 s reached\n"
    assert processes_with(token) == []


def test_command_not_found_gives_127(tmp_path):
    assert run("./no such program", cwd=tmp_path).returncode == 127


def test_two_buses_are_apart_and_can_utils_exchange_frames(tmp_path):
    # A receiver is ready when the kernel lists its filter for the bus.
    script = """
        candump -n 1 -T 20000 vcan0 > zero &
        candump -n 1 -T 20000 vcan1 > one &
        until [ "$(grep -c '^ *vcan[01] ' /proc/net/can/rcvlist_all)" = 2 ]; do sleep 0.05; done
        cansend vcan0 181#1122334455667788
        cansend vcan1 201#AA
        wait
    """
    done = run("sh", "-c", script, cwd=tmp_path, options=["--buses", "2", "--timeout", "60"])

    assert done.returncode == 0, done.stderr
    seen = [" ".join((tmp_path / name).read_text().split()) for name in ("zero", "one")]
    assert seen == ["vcan0 181 [8] 11 22 33 44 55 66 77 88", "vcan1 201 [1] AA"]


def test_python_can_exchanges_frames_and_sees_its_own_echo_only_when_asked(tmp_path):
    code = """
import can
with (
    can.Bus(interface="socketcan", channel="vcan0") as daemon,
    can.Bus(interface="socketcan", channel="vcan0", receive_own_messages=True) as rig,
):
    rig.send(can.Message(arbitration_id=0x181, data=bytes(range(8)), is_extended_id=False))
    for bus in (daemon, rig):
        frame = bus.recv(20.0)
        print(hex(frame.arbitration_id), frame.data.hex(), frame.channel)
    print(rig.recv(0.2), daemon.recv(0.2))
"""
    done = run(sys.executable, "-c", code, cwd=tmp_path)

    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == ["0x181 0001020304050607 vcan0"] * 2 + ["None None"]


def test_multicast_goes_round_on_lo(tmp_path):
    code = """
import lcm
url = "udpm://239.255.76.67:7667?ttl=0"
receiver, sender = lcm.LCM(url), lcm.LCM(url)
receiver.subscribe("CHANNEL", lambda channel, data: print(channel, data))
for _ in range(100):
    sender.publish("CHANNEL", b"payload")
    if receiver.handle_timeout(200):
        break
"""
    done = run(sys.executable, "-c", code, cwd=tmp_path)

    assert done.returncode == 0, done.stderr
    assert "CHANNEL b'payload'" in done.stdout


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_killed_runner_leaves_nothing(tmp_path, number):
    token = f"{time.time_ns() % 10**9 + 10**9}"
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    runner = subprocess.Popen(
        [sys.executable, str(RUNNER), "--", "sh", "-c", f"touch started; sleep {token} & wait"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "TMPDIR": str(scratch)},
    )
    assert wait_for((tmp_path / "started").exists, GUEST_LIMIT_S)
    assert list(scratch.iterdir()) != []

    runner.send_signal(number)
    status = runner.wait(timeout=20)

    assert status == (-number if number == signal.SIGKILL else 128 + number)
    assert wait_for(lambda: not processes_with(token) and not processes_with(str(scratch)), 10.0), (
        processes_with(token) + processes_with(str(scratch))
    )
    assert wait_for(lambda: not list(scratch.iterdir()), 10.0)


def test_controllers_need_the_machine_that_has_them(tmp_path):
    options = ["--controllers", "2", "--backend", "uml"]
    done = run("true", cwd=tmp_path, options=options)
    assert done.returncode == 125
    assert done.stderr == "vcanrun: --controllers needs --backend qemu, not uml\n"


@pytest.mark.parametrize("backend", ["uml", "qemu"])
def test_a_missing_backend_gives_125_and_one_sentence(tmp_path, backend):
    package = {"uml": "user-mode-linux", "qemu": "qemu-system-x86"}[backend]
    # A search path with nothing on it; the sbin directories hold no emulator.
    done = run(
        "true", cwd=tmp_path, options=["--backend", backend], env={**os.environ, "PATH": "/nowhere"}
    )

    assert (done.returncode, done.stdout) == (125, "")
    assert done.stderr.count("\n") == 1
    assert f"apt-get install {package}" in done.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--buses", "0"], "'0' is not a number of buses"),
        (["--timeout", "never"], "'never' is not a positive number of seconds"),
        (["--rw", "no-such-directory"], "no-such-directory is not a directory"),
        (["--mem", "much"], "'much' is not a size"),
    ],
)
def test_a_wrong_option_gives_125_and_one_sentence(tmp_path, options, said):
    done = run("true", cwd=tmp_path, options=options)

    assert (done.returncode, done.stdout) == (125, "")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr


def test_verbose_names_the_backend_once_and_the_command_may_ask(tmp_path):
    done = run("sh", "-c", "echo $VCANRUN_BACKEND", cwd=tmp_path, options=["--verbose"])

    assert done.returncode == 0
    assert done.stderr.startswith(f"vcanrun: {done.stdout.strip()}: ")
    assert done.stderr.count("vcanrun:") == 1


def test_native_backend_inside_a_kernel_that_has_vcan(tmp_path):
    """The other backend, tested where this kernel has no vcan: in a guest that has it."""
    inner = [sys.executable, str(RUNNER), "--backend", "native", "--buses", "2", "--"]
    script = "echo $VCANRUN_BACKEND; ip -o link show vcan1; cansend vcan0 123#11 && exit 9"
    done = run(*inner, "sh", "-c", script, cwd=tmp_path)

    assert (done.returncode, done.stderr) == (9, "")
    assert done.stdout.startswith("native\n")
    assert "vcan1: <NOARP,UP,LOWER_UP" in done.stdout


def test_native_backend_without_namespaces_ends_the_daemons_of_the_command(tmp_path):
    """A container may forbid unshare: then the bus of the host is used, and taken away again."""
    refusing = tmp_path / "unshare"
    refusing.write_text("#!/bin/sh\nexit 1\n")
    refusing.chmod(0o755)
    inner = [sys.executable, str(RUNNER), "--backend", "native", "--buses", "2", "--verbose", "--"]
    # The daemon has left the process group before the command ends.
    command = """
        ip -o link show vcan1
        setsid sh -c 'touch away; exec sleep 987654' &
        until [ -e away ]; do sleep 0.05; done
        exit 9
    """
    script = f"""
        PATH={shlex.quote(str(tmp_path))}:$PATH {shlex.join([*inner, "sh", "-c", command])}
        echo status $?
        grep -lz '98765[4]' /proc/[0-9]*/cmdline | grep -v "/$$/"
        ip -o link show vcan1 2>&1
        ip -o link show vcan0
    """
    done = run("sh", "-c", script, cwd=tmp_path)

    lines = done.stdout.splitlines()
    assert "namespaces are refused" in done.stderr
    assert "vcan1: <NOARP,UP,LOWER_UP" in lines[0]
    assert lines[1] == "status 9"
    assert lines[2] == 'Device "vcan1" does not exist.'
    assert "vcan0: <NOARP,UP,LOWER_UP" in lines[3]
