"""Fault texts and what they do to the encoder frames."""

import math

import pytest
from eampc_rig import RigError

from plant_emulator.fault_injection import Delivery, Fault, FaultInjector, parse_fault

DATA = bytes(range(8))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("drop@5", Fault("drop", 5, 6)),
        ("drop@5:3", Fault("drop", 5, 8)),
        ("delay@0:2:0.0031", Fault("delay", 0, 2, 0.0031)),
        ("corrupt@7::13", Fault("corrupt", 7, 8, 13.0)),
        ("freeze@9", Fault("freeze", 9, math.inf)),
        ("stop@9:4", Fault("stop", 9, 13)),
    ],
)
def test_texts(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("dorp@5", 'unknown kind "dorp".*did you mean "drop"'),
        ("drop", "write KIND@FRAME"),
        ("drop@x", 'FRAME is "x"'),
        ("drop@1:0", 'COUNT is "0", but must be a whole number from 1 on'),
        ("drop@1:2:3", "drop takes no VALUE"),
        ("delay@1:2:-3", "must be a delay in seconds"),
        ("corrupt@1::64", "bits 0..63"),
        ("drop@1:2:3:4", "write KIND@FRAME"),
    ],
)
def test_wrong_texts_are_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(RigError, match=sentence) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


def injector(*texts: str) -> FaultInjector:
    return FaultInjector([parse_fault(text) for text in texts], 0.005)


def test_deliveries() -> None:
    faults = injector("drop@1:2", "duplicate@4", "corrupt@5::8", "delay@6", "stop@8")
    assert faults.deliveries(0, DATA) == [Delivery(0.0, DATA)]
    assert faults.deliveries(1, DATA) == faults.deliveries(2, DATA) == []
    assert faults.deliveries(4, DATA) == [Delivery(0.0, DATA)] * 2
    assert faults.deliveries(5, DATA) == [Delivery(0.0, bytes([0, 0, 2, 3, 4, 5, 6, 7]))]
    assert faults.deliveries(6, DATA) == [Delivery(0.0025, DATA)]
    assert not faults.silent(7)
    assert faults.silent(100)
    assert faults.deliveries(100, DATA) == []


def test_freeze_holds_the_first_frames_values() -> None:
    faults = injector("freeze@2:2")
    said = [faults.measured(frame, 0.1 * frame, 1.0 * frame) for frame in range(5)]
    assert said[2] == said[3] == (0.2, 2.0)
    assert said[1] == (0.1, 1.0)
    assert said[4] == (0.4, 4.0)
