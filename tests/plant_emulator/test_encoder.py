"""Counts, noise and its seed."""

import math

import pytest
from eampc_rig import Frames, Rig

from plant_emulator.encoder import Encoder

COUNT_RAD = 2.0 * math.pi / 131072.0  # 17 bit


def test_one_count_is_that_of_the_dbc(reference_rig: Rig, reference_frames: Frames) -> None:
    encoder = Encoder.from_rig(reference_rig, reference_frames)
    angle, velocity = encoder.measure(1000.4 * COUNT_RAD, 0.00074)
    assert angle == pytest.approx(1000 * COUNT_RAD, rel=1e-12)
    assert velocity == pytest.approx(0.0005)
    assert encoder.measure(-0.6 * COUNT_RAD, 0.0)[0] == pytest.approx(-COUNT_RAD)


def test_counts_survive_the_frame(reference_rig: Rig, reference_frames: Frames) -> None:
    encoder = Encoder.from_rig(reference_rig, reference_frames)
    angle, velocity = encoder.measure(-0.512345, 3.21987)
    data = reference_frames.encoder.encode({"angle": angle, "velocity": velocity}, 3)
    said = reference_frames.encoder.decode(data)
    assert said.values["angle"] == pytest.approx(angle, abs=1e-15)
    assert said.values["velocity"] == pytest.approx(velocity, abs=1e-15)
    assert abs(said.values["angle"] + 0.512345) <= 0.5 * COUNT_RAD


def test_noise_has_its_sigma_and_repeats() -> None:
    def readings(seed: int) -> list[float]:
        encoder = Encoder(1e-6, 1e-6, 0.01, 0.02, seed)
        return [encoder.measure(0.0, 0.0)[0] for _ in range(4000)]

    first = readings(1)
    assert first == readings(1)
    assert first != readings(2)
    sigma = math.sqrt(sum(value * value for value in first) / len(first))
    assert sigma == pytest.approx(0.01, rel=0.05)


def test_position_only_encoder_says_no_velocity() -> None:
    assert Encoder(1e-3, None).measure(0.5004, 3.0) == (pytest.approx(0.5), 0.0)
