"""`eampc plot`: a log as lcm-logger writes it → figures. The logs are made without a network."""

import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import lcm
import numpy as np
import pytest
from eampc.errors import UserError
from eampc.telemetry_log import loop_data, read_telemetry_log
from eampc_lcm import health_t, plant_t, state_t
from matplotlib.image import imread

Eampc = Callable[..., subprocess.CompletedProcess[str]]
FIRST_US = 1_700_000_000_000_000
PERIOD_US = 5000


def state(number: int) -> state_t:
    message = state_t()
    message.utime = FIRST_US + number * PERIOD_US
    message.cycle = number
    message.reference_angle_rad = 0.5 * math.sin(0.01 * number)
    message.angle_rad = message.reference_angle_rad + 0.001
    message.u1_V, message.u2_V = 6.0, 4.0
    message.disturbance_rad_s2 = 20.0
    message.mode_text = "ARMING" if number < 100 else "ACTIVE"
    message.fault_text = message.limits_text = ""
    message.arrival_to_wake_us, message.wake_to_decided_us = 10.0, 5.0
    message.decided_to_sent_us, message.arrival_to_sent_us = 20.0, 35.0 + number % 7
    return message


def plant(number: int) -> plant_t:
    message = plant_t()
    message.utime = FIRST_US + number * PERIOD_US + 100
    message.frame = number
    message.angle_rad = 0.5 * math.sin(0.01 * number)
    message.disturbance_rad_s2 = 21.0
    return message


def write_log(path: Path, channels: dict[str, Callable[[int], bytes]], count: int = 400) -> Path:
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number in range(count):
        for channel, payload in channels.items():
            log.write_event(FIRST_US + number * PERIOD_US, channel, payload(number))
    log.close()
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(
        tmp_path / "run.lcmlog",
        {
            "EAMPC_STATE": lambda number: state(number).encode(),
            "EAMPC_PLANT": lambda number: plant(number).encode(),
            "OTHER": lambda number: b"not ours",
        },
    )


def test_curves_are_the_messages(log: Path) -> None:
    data = loop_data(read_telemetry_log(log))
    assert len(data.cycle_time_s) == len(data.plant_time_s) == 400
    assert data.cycle_time_s[:3] == pytest.approx([0.0, 0.005, 0.010])
    assert data.plant_time_s[0] == pytest.approx(0.0001)
    assert data.cycle_u1_V[0] == 6.0
    assert data.plant_disturbance_rad_s2[7] == 21.0
    assert data.mode_changes == [(pytest.approx(0.5), "ACTIVE")]
    # A reference that nothing follows is no error of the joint.
    assert np.isnan(data.cycle_reference_rad[:100]).all()
    assert np.isfinite(data.cycle_reference_rad[100:]).all()


def test_every_figure_is_drawn(eampc: Eampc, log: Path, tmp_path: Path) -> None:
    done = eampc("plot", log, "--out", tmp_path / "figures")
    assert done.returncode == 0, done.stderr
    names = ["tracking", "error", "voltages", "disturbance", "timing"]
    files = [tmp_path / "figures" / f"{name}.png" for name in names]
    assert done.stdout.split() == [str(file) for file in files]
    for file in files:
        pixels = imread(file)
        assert pixels.shape[0] > 300
        assert np.std(pixels[..., :3]) > 0.02  # something is drawn


def test_figures_lie_beside_the_log_by_default(eampc: Eampc, log: Path) -> None:
    done = eampc("plot", log)
    assert done.returncode == 0, done.stderr
    assert (log.parent / "run.lcmlog.plots" / "tracking.png").is_file()


@pytest.mark.parametrize("channel", ["EAMPC_STATE", "EAMPC_PLANT"])
def test_one_side_alone_is_drawn_too(eampc: Eampc, tmp_path: Path, channel: str) -> None:
    make = {"EAMPC_STATE": state, "EAMPC_PLANT": plant}[channel]
    path = write_log(tmp_path / "log", {channel: lambda number: make(number).encode()})
    done = eampc("plot", path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "log.plots" / "tracking.png").is_file()


def test_log_cut_short_by_a_crash_is_drawn_as_far_as_it_goes(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-37])
    assert len(read_telemetry_log(log).messages["EAMPC_STATE"]) == 400


def test_messages_of_another_layout_are_counted(tmp_path: Path) -> None:
    def some(number: int) -> bytes:
        good = state(number).encode()
        return good if number % 2 else bytes(8) + good[8:]  # the fingerprint comes first

    recorded = read_telemetry_log(write_log(tmp_path / "log", {"EAMPC_STATE": some}, 10))
    assert recorded.undecodable == 5
    assert len(recorded.messages["EAMPC_STATE"]) == 5


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        ({"OTHER": lambda _: b"x"}, "holds no EAMPC_STATE or EAMPC_PLANT message, but OTHER"),
        ({"EAMPC_STATE": lambda _: bytes(16)}, "another version of eampc wrote it"),
        ({"EAMPC_HEALTH": lambda _: health().encode()}, "holds no EAMPC_STATE"),
    ],
)
def test_log_without_curves_is_a_sentence(
    tmp_path: Path, channels: dict[str, Callable[[int], bytes]], sentence: str
) -> None:
    path = write_log(tmp_path / "log", channels, 3)
    with pytest.raises(UserError) as caught:
        read_telemetry_log(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert sentence in str(caught.value)


def health() -> health_t:
    message = health_t()
    message.version = message.rig_name = message.law_sha256 = message.bus = ""
    message.mode_text = message.fault_text = message.realtime_text = ""
    return message
