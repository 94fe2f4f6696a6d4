"""Modes, points and lines in universal files: both ways, beside pyuff."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff

from armonic.comparison import ModeTable, compare
from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap
from armonic.files.measured_file import Geometry
from armonic.files.measured_files import read_measured, write_measured
from armonic.files.measured_uff import read_measured_uff
from armonic.files.measured_uff_writer import write_measured_uff
from frf_files import units
from measured_systems import COMPLEX, KUKA
from uff_files import save

FIELD = 1e-6
"""Of a shape of order one: 12 columns hold seven digits or more, six if they need an exponent."""


def table(places: int = 2, *, rotations: bool = False, modes: int = 4) -> ModeTable:
    rng = np.random.default_rng(9)
    axes = ("x", "y", "z", "rx", "ry", "rz") if rotations else ("x", "y", "z")
    names = [f"{place}.{axis}" for place in ("sensor", "elbow «2»", "7")[:places] for axis in axes]
    shapes = rng.normal(size=(modes, len(names))) + 1j * rng.normal(size=(modes, len(names)))
    w = 2 * np.pi * np.array([3.1234567890123, 10.0, 11.0, 250.0])[:modes]
    poles = w * (-0.01 + 1j * np.sqrt(1 - 1e-4))
    return ModeTable(poles, shapes, tuple(names))


def normal(mode: int, freq_hz: float, shape: list[list[float]], **fields: Any) -> dict[str, Any]:
    """A normal mode of nodes 1, 2, … as pyuff takes it."""
    r = np.array(shape)
    made: dict[str, Any] = {
        "type": 55, "model_type": 1, "analysis_type": 2, "data_ch": 2, "spec_data_type": 8, "load_case": 1,
        "mode_n": mode, "freq": freq_hz, "modal_m": 1.0, "modal_damp_vis": 0.02, "modal_damp_his": 0.0,
        "node_nums": list(range(1, len(r) + 1)), "r1": r[:, 0], "r2": r[:, 1], "r3": r[:, 2],
    }  # fmt: skip
    if r.shape[1] == 6:
        made |= {"data_ch": 3, "r4": r[:, 3], "r5": r[:, 4], "r6": r[:, 5]}
    return made | fields


@pytest.mark.parametrize("rotations", [False, True])
def test_modes_come_back_poles_in_every_bit_and_shapes_by_name(tmp_path: Path, rotations: bool) -> None:
    kept = table(3, rotations=rotations)
    write_measured(tmp_path / "m.uff", modes=kept)
    found = read_measured(tmp_path / "m.uff")
    assert (found.skipped, found.remarks, found.frfs, found.records) == ((), (), None, ())
    assert found.modes is not None
    np.testing.assert_array_equal(found.modes.poles, kept.poles)
    assert found.modes.coordinates == kept.coordinates
    np.testing.assert_allclose(found.modes.shapes, kept.shapes, rtol=0, atol=FIELD * np.abs(kept.shapes).max())


def test_modes_that_came_back_are_paired_with_themselves(tmp_path: Path) -> None:
    kept = table(3)
    write_measured_uff(tmp_path / "m.uff", modes=kept)
    found = read_measured_uff(tmp_path / "m.uff").modes
    assert found is not None
    pairs = compare(found, kept).pairs
    assert [(pair.index_a, pair.index_b) for pair in pairs] == [(k, k) for k in range(4)]
    assert min(pair.mac for pair in pairs if pair.mac is not None) > 1 - 1e-9


@pytest.mark.parametrize("system", [KUKA, COMPLEX])
def test_pyuff_reads_our_modes_with_modal_a_and_b(tmp_path: Path, system: Any) -> None:
    shapes = np.asarray(system.shapes, complex)
    names = tuple(f"{label}" for label in system.outputs)
    modal_a = 2j * system.poles.imag  # of a mode of unit modal mass
    write_measured_uff(tmp_path / "m.uff", modes=ModeTable(system.poles, shapes, names), modal_a=modal_a)
    sets = [s for s in pyuff.UFF(str(tmp_path / "m.uff")).read_sets() if s["type"] == 55]
    assert len(sets) == len(system.poles)
    for found, pole, shape, a in zip(sets, system.poles, shapes, modal_a, strict=True):
        assert (found["analysis_type"], found["data_ch"], found["data_type"], found["n_data_per_node"]) == (3, 2, 5, 3)
        for value, true in ((found["eig"], pole), (found["modal_a"], a), (found["modal_b"], -pole * a)):
            assert abs(value - true) <= FIELD * abs(true)
        own = np.concatenate([found["r1"], found["r2"], found["r3"]])
        np.testing.assert_allclose(own, shape, rtol=0, atol=FIELD * np.abs(shape).max())


@pytest.mark.parametrize("analysis", [3, 7])
def test_complex_modes_of_pyuff_are_read_and_those_that_turn_backwards_turned(tmp_path: Path, analysis: int) -> None:
    r = np.array([[1 + 2j, 3.5, -1j], [0.25, 0, 2]])
    fields = {
        "type": 55, "model_type": 1, "analysis_type": analysis, "data_ch": 2, "spec_data_type": 8, "load_case": 1,
        "node_nums": [11, 12], "r1": r[:, 0], "r2": r[:, 1], "r3": r[:, 2],
    }  # fmt: skip
    pole = -1.5 + 60.25j
    sets = [fields | {"mode_n": 1, "eig": pole}, fields | {"mode_n": 2, "eig": np.conj(2 * pole)}]
    found = read_measured_uff(save(tmp_path / "m.uff", *sets)).modes
    assert found is not None
    np.testing.assert_allclose(found.poles, [pole, 2 * pole], rtol=1e-5)  # six digits
    # The second mode keeps its pole above the axis and so has its shape conjugate; 12.y is zero in both.
    assert found.coordinates == ("11.x", "11.y", "11.z", "12.x", "12.z")
    true = r.ravel()[[0, 1, 2, 3, 5]]
    np.testing.assert_allclose(found.shapes, [true, true.conj()], rtol=1e-5)


def test_normal_modes_have_a_natural_frequency_and_viscous_or_half_the_hysteretic_damping(tmp_path: Path) -> None:
    one, two = [[1.0, 0.5, 0.0], [0.0, -2.0, 0.0]], [[0.25, 0.5, 0.0], [1.0, 1.0, 0.0]]
    sets = [normal(1, 10.0, one), normal(2, 11.5, two, modal_damp_vis=0.0, modal_damp_his=0.03)]
    found = read_measured_uff(save(tmp_path / "m.uff", *sets)).modes
    assert found is not None
    np.testing.assert_allclose(found.natural_freq_hz, [10.0, 11.5], rtol=1e-12)
    np.testing.assert_allclose(found.damping_ratio, [0.02, 0.015], rtol=1e-9)
    assert found.coordinates == ("1.x", "1.y", "2.x", "2.y")
    np.testing.assert_allclose(found.shapes, [[1, 0.5, 0, -2], [0.25, 0.5, 1, 1]])


def test_modes_of_six_degrees_of_freedom_come_in_metres_and_radians(tmp_path: Path) -> None:
    shape = [[1000.0, 0, 0, 0, 0, 0.5]]
    found = read_measured_uff(save(tmp_path / "m.uff", units(1000.0, 1.0), normal(1, 10.0, shape))).modes
    assert found is not None
    assert found.coordinates == ("1.x", "1.rz")
    np.testing.assert_allclose(found.shapes, [[1.0, 0.5]])


def test_a_mode_that_stands_there_for_every_reference_is_read_once(tmp_path: Path) -> None:
    shape = [[1.0, 2.0, 3.0]]
    sets = [normal(1, 10.0, shape), normal(1, 10.0, [[2.0, 4.0, 6.0]]), normal(2, 10.0, [[3.0, 0.0, -1.0]])]
    found = read_measured_uff(save(tmp_path / "m.uff", *sets))
    assert found.modes is not None
    assert len(found.modes.poles) == 2  # the third is the other mode of a symmetric structure
    (left,) = found.skipped
    assert (left.dataset, left.reason) == (2, "its pole is that of data set 1, which is kept")


def test_a_map_names_the_coordinates_of_modes_and_turns_their_signs(tmp_path: Path) -> None:
    path = save(tmp_path / "m.uff", normal(1, 10.0, [[1.0, 2.0, 3.0]]))
    channels = ChannelMap.of([{"node": 1, "place": "sensor", "rotate": {"x": "-z", "z": "x"}}])
    found = read_measured_uff(path, channels=channels).modes
    assert found is not None
    assert found.coordinates == ("sensor.z", "sensor.y", "sensor.x")
    np.testing.assert_allclose(found.shapes, [[-1, 2, 3]])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"analysis_type": 5, "freq_step_n": 1}, r"analysis type 5 \(frequency response\)"),
        ({"data_ch": 4}, "data characteristic 4"),
        ({"freq": 0.0}, "0 Hz"),
        ({"modal_damp_vis": 1.5}, "damping ratio of 1.5"),
        ({"r1": np.array([np.nan])}, "'nan', expected a finite number"),
    ],
)
def test_data_at_nodes_that_are_no_modes_are_left_and_named(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    shape = [[1.0, 2.0, 3.0]]
    found = read_measured_uff(save(tmp_path / "m.uff", normal(1, 10.0, shape), normal(2, 20.0, shape, **change)))
    assert found.modes is not None
    assert len(found.modes.poles) == 1
    (left,) = found.skipped
    assert (left.dataset, left.what) == (2, "data set 55, data at nodes")
    assert re.search(reason, left.reason)


def test_modes_without_shapes_or_at_no_axis_have_no_place_in_the_format(tmp_path: Path) -> None:
    path = tmp_path / "m.uff"
    with pytest.raises(DataFileError, match="modes without shapes"):
        write_measured_uff(path, modes=ModeTable(KUKA.poles))
    with pytest.raises(DataFileError, match=r"coordinate 'link_2', expected PLACE\.AXIS"):
        write_measured_uff(path, modes=ModeTable(np.array([1j]), np.ones((1, 2), complex), ("link_2", "tip.x")))
    with pytest.raises(DataFileError, match="a shape that is not known"):
        write_measured_uff(path, modes=ModeTable(np.array([1j]), np.full((1, 1), np.nan + 0j), ("tip.x",)))
    with pytest.raises(DataFileError, match=r"modal_a: found shape \(2,\), expected 4 finite"):
        write_measured_uff(path, modes=table(), modal_a=[1, 2])
    assert not path.exists()


def points(**fields: Any) -> dict[str, Any]:
    return pyuff.prepare_15(node_nums=[3, 5, 9], x=[0.0, 1.5, 2.5], y=[1.0, -2.0, 0.0], z=[0.125, 0.0, -3.0], **fields)


def trace(*nodes: int) -> dict[str, Any]:
    return pyuff.prepare_82(trace_num=1, n_nodes=len(nodes), color=0, id="NONE", nodes=np.array(nodes))


def test_points_and_lines_of_pyuff_are_read_in_metres(tmp_path: Path) -> None:
    sets = (units(1000.0, 1.0), points(), trace(3, 5, 9, 0, 9, 3))
    found = read_measured_uff(save(tmp_path / "g.uff", *sets))
    assert (found.skipped, found.remarks) == ((), ())
    assert found.geometry is not None
    assert found.geometry.names == ("3", "5", "9")
    true = np.array([[0, 1, 0.125], [1.5, -2, 0], [2.5, 0, -3]]) / 1000
    np.testing.assert_allclose(found.geometry.positions, true, rtol=1e-5)
    assert found.geometry.lines == ((0, 1), (1, 2), (2, 0))


def test_points_of_double_precision_are_read_too(tmp_path: Path) -> None:
    rows = "".join(
        f"{n:10d}{1:10d}{1:10d}{11:10d}\n   {x:.16E}   1.0D+00  -2.5D-01\n" for n, x in ((1, 1 / 3), (2, 0.7))
    )
    (tmp_path / "g.unv").write_text(f"    -1\n  2411\n{rows}    -1\n")
    geometry = read_measured_uff(tmp_path / "g.unv").geometry
    assert geometry is not None
    np.testing.assert_array_equal(geometry.positions, [[1 / 3, 1, -0.25], [0.7, 1, -0.25]])


def test_pyuff_reads_our_points_and_lines(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    names = tuple(f"p{k}" for k in range(300))
    geometry = Geometry(names, rng.normal(size=(300, 3)), tuple((k, (7 * k + 1) % 300) for k in range(299)))
    write_measured_uff(tmp_path / "g.uff", geometry=geometry)
    sets = pyuff.UFF(str(tmp_path / "g.uff")).read_sets()
    (nodes,) = [s for s in sets if s["type"] == 15]
    np.testing.assert_array_equal(nodes["node_nums"], np.arange(1, 301))
    np.testing.assert_allclose(np.column_stack([nodes[axis] for axis in "xyz"]), geometry.positions, atol=1e-6, rtol=0)
    drawn = set()
    for line in (s for s in sets if s["type"] == 82):
        assert line["n_nodes"] == len(line["nodes"]) <= 250  # what the format allows
        drawn |= {(a, b) for a, b in zip(line["nodes"], line["nodes"][1:], strict=False) if a and b}
    assert drawn == {(a + 1, b + 1) for a, b in geometry.lines}
    again = read_measured_uff(tmp_path / "g.uff").geometry
    assert again is not None
    assert (again.names, sorted(again.lines)) == (names, sorted(geometry.lines))


def test_lines_to_unknown_points_are_left_out_and_said(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "g.uff", points(), trace(3, 5, 77, 9)))
    assert found.geometry is not None
    assert found.geometry.lines == ((0, 1),)
    assert found.remarks == ("Lines lead to nodes that are no points of the file (77): they are left out.",)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"-2.0", b"-2,0", "'-2,00000"),
        (b"         5         0", b"         3         0", "node 3 at another place"),
        (b"         5         0", b"         x         0", "'x'"),
    ],
)
def test_damaged_points_are_left_and_named(tmp_path: Path, old: bytes, new: bytes, reason: str) -> None:
    path = save(tmp_path / "g.uff", points(), normal(1, 10.0, [[1.0, 2.0, 3.0]]))
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    found = read_measured_uff(path)
    assert found.geometry is None
    assert found.modes is not None
    (left,) = found.skipped
    assert (left.dataset, left.what) == (1, "data set 15, points")
    assert reason in left.reason
