"""Bad input to eampcd: one sentence on standard error, exit code 2, and nothing left behind."""

import subprocess

import pytest
from toy_daemon import UDP_PORT, eampcd, law_bytes, law_payload

BUS = f"udp_multicast:239.74.163.2:{UDP_PORT}"


@pytest.fixture
def law(tmp_path):
    path = tmp_path / "toy.law"
    path.write_bytes(law_bytes())
    return path


def refused(*arguments: str) -> str:
    """The one sentence."""
    result = subprocess.run(
        [eampcd(), *map(str, arguments)], capture_output=True, text=True, timeout=60
    )
    assert result.returncode == 2, result.stderr
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("eampcd: ")
    return lines[0]


def test_missing_law(tmp_path):
    sentence = refused("--law", tmp_path / "none.law", "--bus", BUS)
    assert "none.law" in sentence
    assert "eampc design" in sentence


def test_truncated_law(tmp_path, law):
    cut = tmp_path / "cut.law"
    cut.write_bytes(law.read_bytes()[:-100])
    assert "cut.law" in refused("--law", cut, "--bus", BUS)


def test_damaged_law(tmp_path, law):
    data = bytearray(law.read_bytes())
    data[len(data) // 2] ^= 1
    damaged = tmp_path / "damaged.law"
    damaged.write_bytes(data)
    assert "damaged.law" in refused("--law", damaged, "--bus", BUS)


@pytest.mark.parametrize(
    ("url", "hint"),
    [
        ("socketcan:can9", "can9"),
        ("socketcan:", "socketcan:INTERFACE"),
        ("can0", "socketcan:INTERFACE"),
        ("udp_multicast:10.0.0.1:43113", "multicast address"),
        ("udp_multicast:239.74.163.2:x", "port"),
    ],
)
def test_bus_that_cannot_be_opened(law, url, hint):
    assert hint in refused("--law", law, "--bus", url)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["--bogus"], "--bogus"),
        ([], "--law"),
        (["--law", "x"], "--bus"),
        (["--law", "x", "--bus", BUS, "--priority", "100"], "--priority"),
        (["--law", "x", "--bus", BUS, "--realtime", "maybe"], "--realtime"),
        (["--law", "x", "--bus", BUS, "--lockstep"], "--emulation"),
    ],
)
def test_wrong_option(arguments, hint):
    assert hint in refused(*arguments)


@pytest.mark.parametrize("url", ["garbage", "udpm://no.such:1", "udpm://239.255.76.67:99999"])
def test_unreachable_lcm(law, tmp_path, url):
    sentence = refused("--law", law, "--bus", BUS, "--socket", tmp_path / "s", "--lcm-url", url)
    assert f"cannot reach LCM at {url}" in sentence
    assert "--lcm-url none" in sentence


def test_rig_of_another_name(law, tmp_path):
    (tmp_path / "rig.toml").write_text('# name = "toy"\n[rig]\nname = "other"   # here\n')
    sentence = refused("--law", law, "--bus", BUS, "--rig", tmp_path)
    assert '"toy"' in sentence
    assert '"other"' in sentence


def test_rig_file_without_a_name(law, tmp_path):
    (tmp_path / "rig.toml").write_text('[joint]\nname = "toy"\n')
    assert "rig.toml" in refused("--law", law, "--bus", BUS, "--rig", tmp_path)


def test_socket_path_that_is_a_file(law, tmp_path):
    path = tmp_path / "precious"
    path.write_text("keep")
    assert "not a socket" in refused("--law", law, "--bus", BUS, "--socket", path)
    assert path.read_text() == "keep"


def test_record_file_that_cannot_be_written(law, tmp_path):
    sentence = refused(
        "--law", law, "--bus", BUS, "--socket", tmp_path / "s", "--record", "/no/such/folder/r.csv"
    )
    assert "/no/such/folder/r.csv" in sentence


def test_law_without_a_leaf(tmp_path):
    payload = law_payload()
    payload["law"]["evaluator"]["root"] = -2
    path = tmp_path / "hole.law"
    path.write_bytes(law_bytes(payload))
    assert "hole.law" in refused("--law", path, "--bus", BUS)


def test_help_and_version():
    for flag, hint in (("--help", "--lockstep"), ("--version", "eampcd ")):
        result = subprocess.run([eampcd(), flag], capture_output=True, text=True, timeout=60)
        assert result.returncode == 0
        assert hint in result.stdout
