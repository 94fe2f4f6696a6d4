"""Units of universal files, and maps from their nodes and channels to the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyuff

from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap
from armonic.files.measured_uff import read_measured_uff
from armonic.series import Channel
from frf_files import DOUBLE_TEXT, units
from uff_files import EVEN_HZ, FORCE, TIME, frf, gamma, record, response, save, tap, wave


def test_millimetres_of_data_set_164_become_metres_and_kilonewtons_newtons(tmp_path: Path) -> None:
    scaled = units(1000.0, 1e-3)
    sets = [record(1, 1, (13, "kN")), record(1, 1, (12, "mm/s^2")), record(1, 4, (8, "rad")), record(1, 2, (8, ""))]
    found = read_measured_uff(save(tmp_path / "a.uff", scaled, *sets, frf((1, 1), (1, 1), units=("NONE", "NONE"))))
    (one,) = found.records
    assert [channel.unit for channel in one.channels] == ["N", "m/s²", "rad", "m"]
    factors = np.array([1e3, 1e-3, 1.0, 1e-3])
    true = np.column_stack([wave(1, 1, 13), wave(1, 1, 12), wave(1, 4, 8), wave(1, 2, 8)]) * factors
    np.testing.assert_allclose(one.values, true, rtol=0, atol=DOUBLE_TEXT * 1e3)
    assert found.frfs is not None
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], response(EVEN_HZ, 1, 1) * 1e-3 / 1e3, rtol=2 * DOUBLE_TEXT)
    assert found.remarks == ()


@pytest.mark.parametrize("first", [(), (units(1.0, 1.0, 1),)])
def test_g_beside_the_values_is_converted_and_said(tmp_path: Path, first: tuple[dict[str, object], ...]) -> None:
    sets = [record(1, 1, (13, "N")), record(1, 1, (12, "g")), frf((1, 1), (1, 1), units=("g/N", "NONE"), types=(12, 0))]
    found = read_measured_uff(save(tmp_path / "a.uff", *first, *sets))
    (one,) = found.records
    assert one.channels[1] == Channel("1.x", "acceleration", "m/s²")
    np.testing.assert_allclose(one["acceleration:1.x"], 9.80665 * wave(1, 1, 12), atol=10 * DOUBLE_TEXT)
    assert found.frfs is not None
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], 9.80665 * response(EVEN_HZ, 1, 1), rtol=2 * DOUBLE_TEXT)
    assert found.remarks == ("Acceleration was converted from g to m/s², by 9.80665.",)


def test_a_file_without_units_is_taken_for_si_and_that_is_said(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, (13, "")), record(1, 1, (12, ""))))
    assert found.records[0].channels[1].unit == "m/s²"
    assert found.remarks == ("The file states no units (data set 164): numbers without any are taken for SI.",)


def test_units_that_contradict_each_other_leave_the_function_unless_a_map_tells_its_scale(tmp_path: Path) -> None:
    path = save(tmp_path / "a.uff", units(1000.0, 1.0), record(1, 1, FORCE), record(1, 1, (12, "g")))
    found = read_measured_uff(path)
    assert found.records[0].labels == ("force:1.x",)
    (left,) = found.skipped
    assert "acceleration" not in found.records[0].labels
    assert str(left).startswith("data set 3, line ")
    assert "labelled 'g', where a data set 164 says that 1 m/s² is 1000" in left.reason
    entry = {"node": 1, "direction": "x", "place": "sensor", "axis": "x", "quantity": "acceleration", "scale": 2.0}
    known = ChannelMap.of([entry])
    mapped = read_measured_uff(path, channels=known)
    assert mapped.skipped == ()
    np.testing.assert_allclose(mapped.records[0]["acceleration:sensor.x"], 2 * wave(1, 1, 12), atol=DOUBLE_TEXT * 2)


def test_an_unknown_unit_is_kept_and_said(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, FORCE), record(1, 1, (12, "V"))))
    assert found.records[0].channels[1].unit == "V"
    assert "Acceleration in V is not converted" in found.remarks[0]


def test_a_type_that_is_not_known_is_told_by_its_unit_or_left(tmp_path: Path) -> None:
    sets = [record(1, 1, (0, "N")), record(1, 1, (1, "m/s")), record(2, 1, (0, "V"))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.records[0].labels == ("force:1.x", "velocity:1.x")
    assert "data type 0 in V" in found.skipped[0].reason


MAP = [
    {"node": 1, "direction": "x", "place": "sensor", "axis": "-z", "quantity": "force"},
    {"node": 1, "direction": "x", "place": "sensor", "axis": "y", "quantity": "acceleration"},
    {"node": 2, "place": "tip", "rotate": {"x": "-z", "z": "x"}},
]


def test_a_map_turns_nodes_and_directions_into_places_and_axes_of_the_robot(tmp_path: Path) -> None:
    points = pyuff.prepare_15(node_nums=[1, 2], x=[0.0, 1.0], y=[0.0, 2.0], z=[0.0, 3.0])
    sets = (points, *tap(), frf((2, -3), (1, 1)), gamma((2, -3), (1, 1)))
    found = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=ChannelMap.of(MAP))
    (one,) = found.records
    assert one.labels == ("force:sensor.z", "acceleration:sensor.y", "acceleration:tip.x")
    true = np.column_stack([-wave(1, 1, 13), wave(1, 1, 12), -wave(2, -3, 12)])
    np.testing.assert_allclose(one.values, true, atol=DOUBLE_TEXT)
    assert found.frfs is not None
    assert (found.frfs.outputs, found.frfs.inputs) == (("tip.x",), ("sensor.z",))
    # Both -z at the response and -x at the force turn: the file's -3 has one sign, the map's -z of the force another.
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], -response(EVEN_HZ, 3, 1), rtol=2 * DOUBLE_TEXT)
    assert found.frfs.coherence is not None
    assert found.geometry is not None
    assert found.geometry.names == ("sensor", "tip")


def test_a_strict_map_leaves_out_what_it_does_not_name(tmp_path: Path) -> None:
    sets = (*tap(), frf((2, -3), (1, 1)), frf((3, 1), (1, 1)))
    found = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=ChannelMap.of(MAP, strict=True))
    assert found.frfs is not None
    assert found.frfs.outputs == ("tip.x",)
    alone = read_measured_uff(tmp_path / "a.uff", channels=ChannelMap.of(MAP[:2], strict=True))
    assert alone.records[0].labels == ("force:sensor.z", "acceleration:sensor.y")
    assert alone.frfs is None


def test_a_map_may_name_channels_as_the_program_that_recorded_them_did(tmp_path: Path) -> None:
    sets = [record(0, 0, FORCE, id1="Hammer", data=1 + TIME), record(0, 0, id1="Front left", data=2 + TIME)]
    entries = [("hammer", "x"), ("Front left", "-y")]
    channels = ChannelMap.of([{"channel": name, "place": "sensor", "axis": axis} for name, axis in entries])
    (one,) = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=channels).records
    assert one.labels == ("force:sensor.x", "acceleration:sensor.y")
    np.testing.assert_allclose(one.values, np.column_stack([1 + TIME, -2 - TIME]), rtol=DOUBLE_TEXT)
    assert read_measured_uff(tmp_path / "a.uff").records[0].labels == ("force:Hammer", "acceleration:Front left")


def test_channels_mapped_twice_are_refused_in_records_and_responses(tmp_path: Path) -> None:
    twice = ChannelMap.of([{"node": k, "direction": "x", "place": "sensor", "axis": "x"} for k in (1, 2)])
    records = save(tmp_path / "a.uff", record(1, 1), record(2, 1))
    frfs = save(tmp_path / "b.uff", frf((1, 1), (3, 1)), frf((2, 1), (3, 1)))
    for path, quantity in ((records, "acceleration"), (frfs, "motion")):
        with pytest.raises(DataFileError, match=rf"both mapped onto {quantity}:sensor.x"):
            read_measured_uff(path, channels=twice)


def test_nodes_of_one_number_in_two_components_are_two_places(tmp_path: Path) -> None:
    sets = [frf((1, 1), (9, 1), rsp_ent_name="arm"), frf((1, 1), (9, 1), rsp_ent_name="base")]
    frfs = read_measured_uff(save(tmp_path / "a.uff", *sets)).frfs
    assert frfs is not None
    assert frfs.outputs == ("arm:1.x", "base:1.x")


def test_kinds_are_brought_to_one_and_that_is_said(tmp_path: Path) -> None:
    sets = [frf((1, 1), (1, 1)), frf((1, 2), (1, 1), types=(8, 13), units=("m", "N"))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert found.frfs.kind == "accelerance"
    np.testing.assert_allclose(found.frfs.values[:, 1, 0], response(EVEN_HZ, 2, 1), rtol=4 * DOUBLE_TEXT)
    assert "converted to accelerance, 1.y to 1.x among them" in found.remarks[0]
