"""A law that is not what was designed is caught when it is loaded or when it is certified.

Every change but the flipped bit gets a checksum of its own, so that only the proofs stand guard.
"""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Eampc
from eampc.certificate import certify
from eampc.errors import LawFileError
from eampc.law import Law, load_law
from ready_rigs import law_of


@pytest.fixture(scope="module")
def law() -> Law:
    return law_of("paper-case2", "theorem")


@pytest.fixture(scope="module")
def tree() -> Law:
    law = law_of("paper-case2", "tracking")
    assert law.tables.kind == "tree"
    assert len(law.tables.node_planes) > 0
    return law


def reloaded(law: Law, folder: Path, change: Any) -> Law:
    payload = copy.deepcopy(dict(law.payload))
    change(payload["law"])
    Law(payload).save(folder / "changed.law")
    return load_law(folder / "changed.law")


def test_the_law_itself_is_proved(law: Law, tmp_path: Path) -> None:
    certificate = certify(reloaded(law, tmp_path, lambda _: None))
    assert certificate.proved, certificate.failure
    assert certificate.failure == ""


@pytest.mark.parametrize("position", [0.1, 0.35, 0.6, 0.85])
def test_one_flipped_bit_is_refused(law: Law, tmp_path: Path, position: float) -> None:
    data = bytearray(law.to_bytes())
    data[int(position * len(data))] ^= 0x10
    path = tmp_path / "flipped.law"
    path.write_bytes(data)
    with pytest.raises(LawFileError, match=r"checksum|damaged|not a law file"):
        load_law(path)


@pytest.mark.parametrize("key", ["piece_gain", "piece_offset"])
def test_one_number_that_is_none_is_refused(law: Law, tmp_path: Path, key: str) -> None:
    def change(section: dict[str, Any]) -> None:
        section[key].flat[0] = np.nan

    with pytest.raises(LawFileError, match="finite"):
        reloaded(law, tmp_path, change)


def test_a_swapped_gain_is_not_proved(law: Law, tmp_path: Path) -> None:
    pieces = law.payload["law"]["piece_gain"]
    for piece in range(0, len(pieces), 4):
        if pieces[piece, 0] == pieces[piece, 1]:
            continue

        def change(section: dict[str, Any], piece: int = piece) -> None:
            section["piece_gain"][piece, [0, 1]] = section["piece_gain"][piece, [1, 0]]

        certificate = certify(reloaded(law, tmp_path, change))
        assert not certificate.proved, piece
        assert "does not give the law" in certificate.failure


def test_a_removed_region_is_not_proved(law: Law, tmp_path: Path) -> None:
    for removed in range(0, len(law.active_sets), 5):

        def change(section: dict[str, Any], removed: int = removed) -> None:
            section["active_sets"] = np.delete(section["active_sets"], removed, axis=0)

        certificate = certify(reloaded(law, tmp_path, change))
        assert not certificate.proved, removed
        assert certificate.figures["coverage"] == "not proved"


def test_a_region_listed_twice_or_with_another_active_set_is_not_proved(
    law: Law, tmp_path: Path
) -> None:
    def repeat(section: dict[str, Any]) -> None:
        section["active_sets"] = np.vstack([section["active_sets"], section["active_sets"][3:4]])

    assert "twice" in certify(reloaded(law, tmp_path, repeat)).failure
    for region in (0, 20, 40):

        def flip(section: dict[str, Any], region: int = region) -> None:
            section["active_sets"][region, 0] ^= 1 << 2

        assert not certify(reloaded(law, tmp_path, flip)).proved, region


def test_a_wrong_child_is_not_proved(tree: Law, tmp_path: Path) -> None:
    children = tree.payload["law"]["evaluator"]["node_children"]
    root = tree.payload["law"]["evaluator"]["root"]
    assert children[root, 0] != children[root, 7]

    def change(section: dict[str, Any]) -> None:
        codes = section["evaluator"]["node_children"]
        codes[root, [0, 7]] = codes[root, [7, 0]]

    assert not certify(reloaded(tree, tmp_path, change)).proved


def test_exchanged_leaves_of_a_flat_law_are_not_proved(law: Law, tmp_path: Path) -> None:
    assert law.tables.kind == "flat"

    def change(section: dict[str, Any]) -> None:
        for name in ("leaf_bits", "leaf_care"):
            leaves = section["evaluator"][name]
            leaves[[0, -1]] = leaves[[-1, 0]]

    assert not certify(reloaded(law, tmp_path, change)).proved


def test_a_wrong_plane_sign_is_not_proved(law: Law, tree: Law, tmp_path: Path) -> None:
    evaluator = tree.payload["law"]["evaluator"]
    for of, plane in ((law, 0), (tree, evaluator["node_planes"][evaluator["root"], 0])):

        def change(section: dict[str, Any], plane: int = plane) -> None:
            section["evaluator"]["hyperplanes"][plane] *= -1.0

        assert not certify(reloaded(of, tmp_path, change)).proved, of


def test_the_command_tells_proved_from_not_proved_and_from_bad_input(
    law: Law, tmp_path: Path, eampc: Eampc
) -> None:
    path = tmp_path / "rig.law"
    law.save(path)
    good = eampc("certify", path, "--report", tmp_path / "page.html")
    assert good.returncode == 0, good.stderr
    assert "proved" in good.stdout
    assert "<h1>Certificate of the law paper-case2, variant theorem</h1>" in (
        tmp_path / "page.html"
    ).read_text(encoding="utf-8")

    def remove(section: dict[str, Any]) -> None:
        section["active_sets"] = section["active_sets"][1:]

    reloaded(law, tmp_path, remove)
    bad = eampc("certify", tmp_path / "changed.law", "--json")
    assert bad.returncode == 1
    assert json.loads(bad.stdout)["coverage"] == "not proved"
    assert "not proved" in bad.stderr

    def boast(section: dict[str, Any]) -> None:
        section["certificate"] = {**section["certificate"], "regions": 70}

    reloaded(law, tmp_path, boast)
    other = eampc("certify", tmp_path / "changed.law")
    assert other.returncode == 1
    assert "says regions = 70" in other.stderr

    path.write_bytes(law.to_bytes()[:-1])
    assert eampc("certify", path).returncode == 2
    assert eampc("certify", path, "--report", tmp_path / "page.pdf").returncode == 2
