"""EAMPC_PLANT on the wire, and a network that refuses."""

import socket
from typing import Any

import eampc_lcm
import lcm
import pytest

from plant_emulator.telemetry import CHANNEL, Telemetry
from plant_emulator.truth_log import COLUMNS

ROW = tuple(float(index) for index in range(len(COLUMNS)))


@pytest.fixture
def lcm_url() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return f"udpm://239.255.76.67:{probe.getsockname()[1]}?ttl=0"


def test_each_field_carries_its_column(lcm_url: str) -> None:
    heard: list[Any] = []
    listener = lcm.LCM(lcm_url)
    listener.subscribe(CHANNEL, lambda _, data: heard.append(eampc_lcm.plant_t.decode(data)))
    Telemetry(lcm_url, pytest.fail).publish(ROW)
    assert listener.handle_timeout(5000) > 0
    for index, name in enumerate(COLUMNS[:10]):
        assert getattr(heard[0], name) == index
    assert heard[0].valve_node_safe is True


def test_a_network_that_refuses_is_told_once(lcm_url: str) -> None:
    class Refusing:
        def publish(self, channel: str, data: bytes) -> None:
            raise OSError("Network is unreachable")

    said: list[str] = []
    telemetry = Telemetry(lcm_url, said.append)
    telemetry._lcm = Refusing()
    telemetry.publish(ROW)
    telemetry.publish(ROW)
    assert len(said) == 1
    assert "does not take messages (Network is unreachable); going on without" in said[0]


def test_none_publishes_nothing() -> None:
    Telemetry("none", pytest.fail).publish(ROW)
