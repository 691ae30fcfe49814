"""The law file: round trip, and one sentence for every kind of damage."""

import zlib
from pathlib import Path
from typing import Any

import daqp
import msgpack
import numpy as np
import pytest
from eampc.errors import LawFileError
from eampc.law import Law, load_law
from eampc.law_design import design
from eampc.law_file import decode_law, encode_law
from ready_rigs import law_of, rig_of


@pytest.fixture(scope="module")
def law() -> Law:
    return law_of("paper-case1", "tracking")


def assert_same(a: Any, b: Any) -> None:
    """Equal maps, lists, numbers and arrays, bit by bit."""
    if isinstance(a, dict):
        assert set(a) == set(b)
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        assert a.shape == b.shape
        assert a.tobytes() == b.tobytes()
    else:
        assert a == b


def test_round_trip(law: Law, tmp_path: Path) -> None:
    path = tmp_path / "rig.law"
    assert law.save(path) == path.stat().st_size
    again = load_law(path)
    assert_same(again.payload, law.payload)
    assert again.to_bytes() == law.to_bytes()
    assert again.design_seconds is None
    assert [file.name for file in tmp_path.iterdir()] == ["rig.law"]


def test_same_inputs_give_the_same_bytes(law: Law) -> None:
    assert design(rig_of("paper-case1", "tracking")).to_bytes() == law.to_bytes()


def test_every_truncation_is_refused(law: Law) -> None:
    data = law.to_bytes()
    for length in [*range(0, 400, 7), *range(400, len(data), 997), len(data) - 1]:
        with pytest.raises(LawFileError):
            decode_law(data[:length], "short.law")


def test_every_flipped_bit_of_the_payload_is_seen(law: Law) -> None:
    data = law.to_bytes()
    random = np.random.default_rng(5)
    for at in random.integers(0, len(data), 300):
        damaged = bytearray(data)
        damaged[at] ^= 1 << int(random.integers(8))
        with pytest.raises(LawFileError):
            decode_law(bytes(damaged), "flipped.law")


def repacked(law: Law, change: Any) -> bytes:
    """The file with a changed payload and a right checksum."""
    payload = msgpack.unpackb(msgpack.unpackb(law.to_bytes())["payload"])
    change(payload)
    body = msgpack.packb(payload)
    return msgpack.packb(
        {"format": "eampc-law", "version": 3, "crc32": zlib.crc32(body), "payload": body}
    )


def _set(*path: str, value: Any):
    def change(payload: dict[str, Any]) -> None:
        table = payload
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = value

    return change


def _remove(*path: str):
    def change(payload: dict[str, Any]) -> None:
        table = payload
        for key in path[:-1]:
            table = table[key]
        del table[path[-1]]

    return change


NOT_A_NUMBER = {"shape": [2], "f64": np.array([1.0, np.nan]).tobytes()}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_remove("safety"), "section safety is missing"),
        (_remove("model", "b1"), "model.b1 is missing"),
        (_set("model", "order", value=4), "model.order"),
        (_set("estimator", "kalman_state_gain", value=NOT_A_NUMBER), "not finite"),
        (_remove("law", "evaluator"), "law.evaluator is missing"),
        (_remove("law", "evaluator", "fold"), "law.evaluator.fold is missing"),
        (_set("law", "evaluator", "root", value=10**6), "law.evaluator.root names a node or leaf"),
        (_set("law", "evaluator", "root", value=10**12), "law.evaluator.root must be a whole"),
        (_set("law", "evaluator", "depth", value=1), "law.evaluator.depth is 1, but the longest"),
        (_set("law", "evaluator", "kind", value="flat"), "belongs to a tree"),
        (_set("law", "evaluator", "worst_operations", value=7), "is 7, but an evaluation takes"),
        (_set("law", "evaluator", "term_first", value=NOT_A_NUMBER), "not finite"),
        (_set("law", "evaluator", "leaf_first", value=[0]), "law.evaluator.leaf_first must be"),
        (_set("law", "active_sets", value={"shape": [1, 9], "i32": bytes(36)}), "law.active_sets"),
        (_set("law", "lower", value={"shape": [1], "f64": bytes(8)}), "law.lower"),
        (_set("law", "lower", value={"shape": [9], "f64": bytes(8)}), "as its shape"),
        (_set("law", "u_min", value=1e9), "u_min"),
        (_set("problem", "H", value=3), "problem.H"),
    ],
)
def test_defects_with_a_right_checksum(law: Law, change: Any, says: str) -> None:
    with pytest.raises(LawFileError, match=says) as caught:
        decode_law(repacked(law, change), "odd.law")
    text = str(caught.value)
    assert text.startswith("odd.law: ")
    assert "\n" not in text
    assert "eampc design" in text


def test_other_versions_and_other_files(law: Law, tmp_path: Path) -> None:
    outer = msgpack.unpackb(law.to_bytes())
    with pytest.raises(LawFileError, match="version 2, but this eampc reads version 3"):
        decode_law(msgpack.packb({**outer, "version": 2}), "old.law")
    with pytest.raises(LawFileError, match="checksum"):
        decode_law(msgpack.packb({**outer, "crc32": outer["crc32"] ^ 1}), "bad.law")
    for data in (b"", b"\x00", b"[rig]\nname = 1\n", msgpack.packb([1, 2]), b"\xc1" * 40):
        with pytest.raises(LawFileError, match="is not a law file"):
            decode_law(data, "other.law")
    with pytest.raises(LawFileError, match="no such file"):
        load_law(tmp_path / "missing.law")
    with pytest.raises(LawFileError, match="cannot be read"):
        load_law(tmp_path)
    with pytest.raises(LawFileError, match="cannot be written"):
        law.save(tmp_path / "no" / "folder.law")


def test_the_daemon_reads_what_python_writes(law: Law) -> None:
    checked = law.checked
    assert checked.rig_name == "paper-case1"
    assert checked.variant == "tracking"
    assert checked.inputs_sha256 == rig_of("paper-case1", "tracking").inputs_sha256
    assert checked.parameter_names == list(law.parameter_names)
    assert checked.upper.tolist() == law.upper.tolist()


def test_nothing_in_it_tells_when_or_where(law: Law) -> None:
    assert "seconds" not in law.statistics
    assert b"/" + b"work" not in encode_law(law.payload)


def test_active_sets_are_those_of_the_regions(law: Law) -> None:
    """At a sampled parameter, the active rows of an online solution are one of the sets listed."""
    listed = {tuple(rows) for rows in law.active_sets}
    assert len(listed) == law.statistics["regions"]
    problem = law.problem
    random = np.random.default_rng(2)
    found = 0
    for p in random.uniform(law.lower, law.upper, size=(200, len(law.lower))):
        room = problem.w + problem.S @ p
        lower = np.full_like(room, -1e30)
        kinds = np.zeros(len(room), dtype=np.int32)
        _, _, flag, info = daqp.solve(
            problem.H, problem.F @ p + problem.f, problem.G, room, lower, kinds, primal_tol=1e-9
        )
        assert flag == 1
        active = tuple(np.flatnonzero(np.abs(info["lam"]) > 1e-9).tolist())
        found += active in listed
    assert found > 190  # weakly active rows leave a few undecided
