"""Exit codes and sentences of `python -m plant_emulator`."""

import csv
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from plant_emulator import command_line
from plant_emulator.truth_log import COLUMNS, TruthLog

RIG = str(Path(__file__).parents[2] / "rigs" / "reference")
URL = "udp_multicast:239.74.163.2:43999"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "Missing argument 'RIG'; see --help"),
        ([RIG], "Missing option '--bus'; see --help"),
        ([RIG, "--bus", "can0"], 'bus "can0": unknown transport "can0"; use socketcan:'),
        ([RIG, "--bus", "socketcan:eampc-none"], 'there is no interface "eampc-none"'),
        ([RIG, "--bus", URL, "--frames", "0"], "Invalid value for '--frames'"),
        ([RIG, "--bus", URL, "--scenario", "stp"], 'no scenario "stp"; did you mean "step"?'),
        ([RIG, "--bus", URL, "--variant", "x"], 'there is no variant "x"; it has kalman'),
        ([RIG, "--bus", URL, "--set", "control.period_ms=5"], "did you mean control.period_s"),
        ([RIG, "--bus", URL, "--set", "horizon"], '"horizon" is not an override; write key=value'),
        ([RIG, "--bus", URL, "--fault", "dorp@1"], 'did you mean "drop"?'),
        ([RIG, "--bus", URL, "--log", "truth.txt"], "must end in .csv or .npz"),
        ([RIG, "--bus", URL, "--log", "/nowhere/truth.csv"], "the folder /nowhere does not exist"),
        ([RIG, "--bus", URL, "--log", "/proc/truth.csv"], '--log "/proc/truth.csv": cannot be'),
        (["/nowhere", "--bus", URL], "/nowhere: there is no such file"),
        ([RIG, "--bus", URL, "--lcm-url", "udp://x"], "or give --lcm-url none"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_2(
    arguments: list[str], sentence: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert command_line.main(arguments) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if "no LCM telemetry" not in line]
    assert len(lines) == 1
    assert lines[0].startswith("plant_emulator: ")
    assert sentence in lines[0]


def test_help_is_exit_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.main(["--help"]) == 0
    assert "--lead-frames" in capsys.readouterr().out


def test_asking_for_lcm_without_its_types_is_bad_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "eampc_lcm", None)
    assert command_line.main([RIG, "--bus", URL, "--lcm-url", "udpm://239.255.76.67:7667"]) == 2
    assert "needs the module eampc_lcm, which is not installed" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_truth_log_keeps_rows_in_columns(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"truth{suffix}"
    log = TruthLog(path)
    log.append((*(float(index) for index in range(12)), math.nan))
    log.append(tuple(float(index) + 0.1 for index in range(13)))
    log.write()
    if suffix == ".csv":
        with path.open(newline="") as file:
            rows = list(csv.reader(file))
        assert rows[0] == list(COLUMNS)
        assert float(rows[2][2]) == 2.1
        assert math.isnan(float(rows[1][12]))
    else:
        with np.load(path) as table:
            assert sorted(table.files) == sorted(COLUMNS)
            assert table["angle_rad"].tolist() == [2.0, 2.1]
