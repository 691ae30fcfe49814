"""CSV trajectories: expected numbers by hand, from polynomials and sines whose derivatives are
known.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from eampc.errors import UserError
from eampc.reference_table import LARGEST_ROW_COUNT, ReferenceTable, load_reference_table

T = 0.005


def write(folder: Path, text: str) -> Path:
    path = folder / "trajectory.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_row_limit_is_the_daemon_s() -> None:
    """A larger table than the daemon's was sent, and the connection broke without a sentence."""
    header = Path(__file__).parents[2] / "daemon" / "service" / "operator_request.hpp"
    found = re.search(r"kMaxTableRows = ([0-9']+);", header.read_text(encoding="utf-8"))
    assert found is not None
    assert int(found[1].replace("'", "")) == LARGEST_ROW_COUNT


def test_rows_on_the_grid_are_kept(tmp_path: Path) -> None:
    table = load_reference_table(
        write(tmp_path, "time_s,angle_rad\n0,0.0\n0.005,0.1\n0.010,0.4\n"), T
    )
    assert table.sample_period_s == T
    assert table.rows[:, 0] == pytest.approx([0.0, 0.1, 0.4])


def test_angle_alone_gets_its_derivatives(tmp_path: Path) -> None:
    """θ = t²: second-order differences are exact for it, so θ̇ = 2t and θ̈ = 2."""
    times = np.linspace(0.0, 1.0, 21)
    body = "\n".join(f"{t:.6f},{t * t:.9f}" for t in times)
    table = load_reference_table(write(tmp_path, f"time_s,angle_rad\n{body}\n"), T)
    grid = np.arange(201) * T
    assert len(table.rows) == 201
    assert table.rows[:, 0] == pytest.approx(grid**2, abs=1e-8)
    assert table.rows[:, 1] == pytest.approx(2 * grid, abs=1e-6)
    assert table.rows[:, 2] == pytest.approx(np.full(201, 2.0), abs=1e-4)


def test_given_velocity_shapes_the_curve_between_rows(tmp_path: Path) -> None:
    """sin(πt) in rows 50 ms apart: the Hermite error bound is h⁴/384·max|θ⁗| = 1.6e-6 rad."""
    times = np.arange(0.0, 2.001, 0.05)
    body = "\n".join(
        f"{t:.6f},{np.sin(np.pi * t):.12f},{np.pi * np.cos(np.pi * t):.12f}" for t in times
    )
    table = load_reference_table(write(tmp_path, f"time_s,angle_rad,velocity_rad_s\n{body}\n"), T)
    grid = np.arange(len(table.rows)) * T
    assert np.max(np.abs(table.rows[:, 0] - np.sin(np.pi * grid))) < 1.6e-6
    assert np.max(np.abs(table.rows[:, 1] - np.pi * np.cos(np.pi * grid))) < 2e-4


def test_given_acceleration_is_interpolated(tmp_path: Path) -> None:
    table = load_reference_table(
        write(tmp_path, "acceleration_rad_s2,time_s,angle_rad\n0,0,0\n10,0.1,0.5\n"), 0.05
    )
    assert table.rows[:, 2] == pytest.approx([0.0, 5.0, 10.0])


def test_first_angle_is_held_before_the_first_time(tmp_path: Path) -> None:
    table = load_reference_table(
        write(tmp_path, "time_s,angle_rad\n0.02,0.3\n0.03,0.4\n0.04,0.5\n"), T
    )
    assert table.rows[:4] == pytest.approx(np.tile([0.3, 0.0, 0.0], (4, 1)))
    assert table.rows[-1, 0] == pytest.approx(0.5)


def test_table_is_read_linearly_and_held_after_its_end() -> None:
    table = ReferenceTable(0.1, np.array([[0.0, 1.0, 0.0], [0.1, 1.0, 0.0]]))
    assert table.at(np.array([0.05, 0.1, 5.0])) == pytest.approx(
        np.array([[0.05, 1.0, 0.0], [0.1, 1.0, 0.0], [0.1, 0.0, 0.0]])
    )


def test_delay_holds_the_first_angle() -> None:
    table = ReferenceTable(0.1, np.array([[0.2, 1.0, 3.0], [0.3, 1.0, 0.0]])).delayed(0.25)
    assert table.rows[:, 0] == pytest.approx([0.2, 0.2, 0.2, 0.2, 0.3])
    assert table.rows[2, 1:] == pytest.approx([0.0, 0.0])
    assert table.rows[3, 1:] == pytest.approx([1.0, 3.0])


def test_byte_order_mark_spaces_and_blank_lines_do_no_harm(tmp_path: Path) -> None:
    text = "\ufefftime_s , angle_rad\n\n0, 0.1\n 0.005 ,0.2\n\n"
    table = load_reference_table(write(tmp_path, text), T)
    assert table.rows[:, 0] == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "time_s is missing"),
        ("time_s,angle_deg\n0,1\n1,2\n", "angle_rad is missing"),
        ("time_s,angle_rad,speed\n0,1,2\n1,2,3\n", "column 'speed' is unknown"),
        ("time_s,angle_rad,angle_rad\n0,1,2\n1,2,3\n", "there twice"),
        ("time_s,angle_rad\n0,1\n", "at least two rows"),
        ("time_s,angle_rad\n0,1\n1\n", "data row 2 (1) is not 2 numbers"),
        ("time_s,angle_rad\n0,1\n1,high\n", "data row 2 (1,high) is not 2 numbers"),
        ("time_s,angle_rad\n0,1\n1,nan\n", "data row 2 holds a value that is not finite"),
        ("time_s,angle_rad\n0,1\n2,1\n1,1\n", "data row 3 has 1 after 2"),
        ("time_s,angle_rad\n-1,1\n2,1\n", "must not be negative"),
        ("time_s,angle_rad\n0,1\n1e9,1\n", f"at most {LARGEST_ROW_COUNT} fit"),
    ],
)
def test_bad_file_is_one_sentence_that_names_it(tmp_path: Path, text: str, sentence: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(UserError) as caught:
        load_reference_table(path, T)
    assert str(caught.value).startswith(f"{path}: ")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        load_reference_table(tmp_path / "none.csv", T)
