"""lcm-spy knows our types: under Xvfb, each channel's window shows decoded fields, not a blank.

Also lcm-logger and `eampc plot` on messages that really crossed the network (multicast, ttl 0).
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import lcm
import numpy as np
import pytest
from matplotlib.image import imread

pytestmark = pytest.mark.timeout(180)

# A group of this test's own: other runs on the machine must not show up in the list of channels.
URL = "udpm://239.255.76.69:7671?ttl=0"
CHANNELS = ["EAMPC_HEALTH", "EAMPC_PLANT", "EAMPC_STATE"]  # in the order of lcm-spy's list
LIMIT_S = 60.0
FIRST_ROW_Y, ROW_HEIGHT = 27, 16
PUBLISHER = """
import sys, time, lcm
from eampc_lcm import health_t, plant_t, state_t
link = lcm.LCM(sys.argv[1])
types = {"EAMPC_STATE": state_t, "EAMPC_PLANT": plant_t, "EAMPC_HEALTH": health_t}
number = 0
while True:
    for channel, kind in types.items():
        message = kind()
        message.utime = time.time_ns() // 1000
        for name in ("mode_text", "fault_text", "limits_text", "version", "rig_name", "law_sha256",
                     "bus", "realtime_text"):
            if hasattr(message, name):
                setattr(message, name, "text")
        if hasattr(message, "mode_text"):
            message.mode_text = "ACTIVE"
        if hasattr(message, "angle_rad"):
            message.angle_rad = 0.001 * (number % 500)
        if hasattr(message, "arrival_to_sent_us"):
            message.arrival_to_sent_us = 30.0 + number % 7
        link.publish(channel, message.encode())
    number += 1
    time.sleep(0.02)
"""
Eampc = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def publisher() -> Iterator[None]:
    process = subprocess.Popen([sys.executable, "-c", PUBLISHER, URL])
    yield
    process.kill()
    process.wait()


@pytest.fixture
def display() -> Iterator[str]:
    """A screen of its own; Xvfb chooses a free number and tells it."""
    read_end, write_end = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write_end), "-noreset", "-screen", "0", "1400x900x24"],
        pass_fds=[write_end],
        stderr=subprocess.DEVNULL,
    )
    os.close(write_end)
    # Number and newline are written one after the other: a pipe closed between them ends Xvfb.
    with os.fdopen(read_end) as pipe:
        number = pipe.readline().strip()
    yield f":{number}"
    server.terminate()
    server.wait()


def windows(display: str, title: str) -> list[str]:
    found = subprocess.run(
        ["xdotool", "search", "--onlyvisible", "--name", f"^{title}$"],
        env={**os.environ, "DISPLAY": display},
        capture_output=True,
        text=True,
    )
    return found.stdout.split()


def wait_for(what: Callable[[], object], text: str) -> object:
    deadline = time.monotonic() + LIMIT_S
    while not (found := what()):
        assert time.monotonic() < deadline, f"no {text} within {LIMIT_S:.0f} s"
        time.sleep(0.2)
    return found


def coloured_fraction(display: str, window: str, picture: Path) -> float:
    """Share of pixels that are not white; a channel that does not decode has a blank window."""
    subprocess.run(
        ["import", "-window", window, str(picture)],
        env={**os.environ, "DISPLAY": display},
        check=True,
    )
    return float(np.mean(np.any(imread(picture)[..., :3] < 0.99, axis=-1)))


@pytest.mark.usefixtures("publisher")
def test_every_channel_is_decoded(
    display: str, tmp_path: Path, eampc_environment: dict[str, str]
) -> None:
    environment = {**eampc_environment, "DISPLAY": display}
    output = tmp_path / "spy.log"
    with open(output, "wb") as log:
        spy = subprocess.Popen(
            [sys.executable, "-m", "eampc.command_line", "spy", "--lcm-url", URL],
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
    try:
        wait_for(lambda: windows(display, "LCM Spy"), "window of lcm-spy")
        wait_for(lambda: "Found 4 LCM types" in output.read_text(), "line 'Found 4 LCM types'")
        for row, channel in enumerate(CHANNELS):
            y = FIRST_ROW_Y + ROW_HEIGHT * row

            def opened(channel: str = channel, y: int = y) -> str | None:
                there = windows(display, channel)
                if not there:  # the list may not be filled yet: click again
                    click = f"mousemove 60 {y} click --repeat 2 --delay 60 1".split()
                    subprocess.run(["xdotool", *click], env=environment, check=True)
                    time.sleep(1.5)
                return there[0] if there else None

            window = str(wait_for(opened, f"window of {channel}"))
            picture = tmp_path / f"{channel}.png"
            wait_for(
                lambda window=window, picture=picture: (
                    coloured_fraction(display, window, picture) > 0.2
                ),
                f"decoded fields of {channel}",
            )
            # Out of the way of the next double click.
            subprocess.run(
                ["xdotool", "windowmove", window, "0", str(300 + 100 * row)],
                env=environment,
                check=True,
            )
    finally:
        spy.kill()
        spy.wait()


@pytest.mark.usefixtures("publisher")
def test_logger_records_and_plot_draws(eampc: Eampc, tmp_path: Path) -> None:
    # The program itself: a SIGTERM to pip's wrapper script would leave it running.
    program = Path(lcm.LCM_BIN_DIR) / "lcm-logger"
    log = tmp_path / "run.lcmlog"
    logger = subprocess.Popen(
        [str(program), f"--lcm-url={URL}", str(log)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(lambda: log.exists() and log.stat().st_size > 20_000, "log of 20 kB")
    finally:
        logger.send_signal(signal.SIGTERM)
        logger.wait(20)
    done = eampc("plot", log, "--out", tmp_path / "figures")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == 5
    assert not done.stderr
