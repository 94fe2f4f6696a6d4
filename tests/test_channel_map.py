"""A channel map names places and axes, turns signs, scales, and says by line what in it makes no sense."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.comparison import ModeTable
from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap, read_channel_map
from armonic.files.mapped import mapped_frfs, mapped_modes, mapped_record
from armonic.files.si_units import si_unit
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries

AXES = ("x", "y", "z", "rx", "ry", "rz")


def written(folder: Path, text: str, name: str = "map.yaml") -> Path:
    (folder / name).write_text(text, "utf-8")
    return folder / name


def mapping(folder: Path, *entries: str) -> Path:
    lines = "".join(f"  - {entry}\n" for entry in entries)
    return written(folder, f"armonic_channels: 1\nchannels:\n{lines}")


def record(*channels: Channel) -> TimeSeries:
    values = np.arange(1.0, 5 * len(channels) + 1).reshape(5, len(channels))
    return TimeSeries(values, 512.0, channels)


def test_a_channel_is_mapped_by_its_name_and_its_sign_turned(tmp_path: Path) -> None:
    chosen = read_channel_map(mapping(tmp_path, '{channel: "Ch 1", place: sensor, axis: -z, quantity: force}'))
    taken = record(Channel("Ch 1", "signal"), Channel("Ch 2", "signal"))
    found = mapped_record(taken, chosen)
    assert found.channels == (Channel("sensor.z", "force", "N"), Channel("Ch 2", "signal"))
    np.testing.assert_array_equal(found.values, taken.values * [-1, 1])


@pytest.mark.parametrize("name", ["Ch 1", "ch 1", "CH  1"])
def test_names_count_without_regard_to_case_and_blanks(tmp_path: Path, name: str) -> None:
    chosen = read_channel_map(mapping(tmp_path, '{channel: "Ch 1", place: sensor, axis: z}'))
    place = chosen.place_of(None, None, name)
    assert place is not None
    assert place.label == "sensor.z"


def test_an_exact_name_goes_before_one_of_other_case() -> None:
    chosen = ChannelMap.of(
        [{"channel": "a", "place": "low", "axis": "x"}, {"channel": "A", "place": "high", "axis": "x"}]
    )
    assert [chosen.place_of(None, None, name).label for name in "aA"] == ["low.x", "high.x"]  # type: ignore[union-attr]


@pytest.mark.parametrize("direction", ["x", "-x"])
@pytest.mark.parametrize("axis", ["y", "-y"])
@pytest.mark.parametrize("code", [1, -1])
def test_signs_of_entry_and_file_multiply(direction: str, axis: str, code: int) -> None:
    chosen = ChannelMap.of([{"node": 12, "direction": direction, "place": "tip", "axis": axis, "scale": 2.0}])
    place = chosen.place_of(12, code, "")
    assert place is not None
    assert (place.label, place.scale) == ("tip.y", 2.0)
    assert place.sign == code * (-1) ** (direction + axis).count("-")


def turned(rotate: dict[str, str]) -> np.ndarray:
    """What the axes of a node are made of in those of its place, (6, 6)."""
    chosen = ChannelMap.of([{"node": 7, "place": "tip", "rotate": rotate}])
    matrix = np.zeros((6, 6))
    for code in range(1, 7):
        place = chosen.place_of(7, code, "")
        assert place is not None
        matrix[AXES.index(place.label.removeprefix("tip.")), code - 1] = place.sign
    return matrix


@pytest.mark.parametrize("rotate", [{"x": "-z", "z": "x"}, {"x": "y", "y": "z", "z": "x"}, {"x": "-x", "y": "-y"}])
def test_the_axes_of_a_turned_node_and_rotations_about_them_turn_by_one_rotation(rotate: dict[str, str]) -> None:
    matrix = turned(rotate)
    R = matrix[:3, :3]
    np.testing.assert_array_equal(R.T @ R, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1)
    # ω × r turns as ω and r do: rotations are vectors, too.
    omega, r = np.array([1.0, 2, 3]), np.array([5.0, -1, 4])
    np.testing.assert_allclose(np.cross(matrix[3:, 3:] @ omega, R @ r), R @ np.cross(omega, r), atol=1e-12)


def test_a_node_without_turns_keeps_its_axes() -> None:
    np.testing.assert_array_equal(turned({"x": "x"}), np.eye(6))


def test_what_is_in_no_entry_keeps_its_name_or_gets_that_of_its_node() -> None:
    free = ChannelMap()
    for node, direction, name, label, sign in [
        (3, 2, "sensor.x", "sensor.x", 1), (3, -2, "", "3.y", -1), (3, 6, "Ch 4", "3.rz", 1),
        (None, None, "elbow.left.Z", "elbow.left.z", 1), (None, None, "tip:-Y", "tip.y", -1),
        (None, None, "Ch 4", "Ch 4", 1), (0, 0, "tip.-rx", "tip.rx", -1),
    ]:  # fmt: skip
        place = free.place_of(node, direction, name)
        assert place is not None
        assert (place.label, place.sign, place.line) == (label, sign, 0)


def test_a_strict_map_leaves_out_what_is_in_no_entry(tmp_path: Path) -> None:
    path = written(
        tmp_path, "armonic_channels: 1\nstrict: true\nchannels:\n  - {channel: a, place: tip, axis: x}\n"
    )  # fmt: skip
    chosen = read_channel_map(path)
    assert chosen.place_of(1, 1, "b") is None
    assert mapped_record(record(Channel("a", "force", "N"), Channel("b", "signal")), chosen).labels == ("force:tip.x",)
    with pytest.raises(DataFileError, match=r"found no channel of the strict map .*The channels are signal:b\."):
        mapped_record(record(Channel("b", "signal")), chosen)


def test_a_map_in_csv_says_the_same_as_one_in_yaml(tmp_path: Path) -> None:
    yaml = mapping(
        tmp_path,
        '{channel: "Ch 1", place: sensor, axis: -z, quantity: force, unit: kN}',
        "{node: 12, direction: -x, place: tip, axis: y, scale: 9.80665}",
        "{node: 13, place: elbow}",
    )
    header = "channel,node,direction,place,axis,quantity,unit,scale\n"
    body = "Ch 1,,,sensor,-z,force,kN,\n\n,12,-x,tip,y,,,9.80665\n,13,,elbow,,,,\n"
    comma = written(tmp_path, "# a comment\n" + header + body, "map.csv")
    excel = (header + body).replace(",", ";").replace("9.80665", "9,80665")
    maps = [read_channel_map(p) for p in (yaml, comma, written(tmp_path, excel, "excel.csv"))]
    for node, direction, name in [(None, None, "ch 1"), (12, 1, ""), (13, -6, "x"), (14, 3, "")]:
        first, *others = (chosen.place_of(node, direction, name) for chosen in maps)
        assert first is not None
        for other in others:
            assert other is not None
            assert (other.label, other.factor, other.quantity, other.unit) == (
                first.label, first.factor, first.quantity, first.unit,
            )  # fmt: skip
    assert not maps[1].strict
    assert read_channel_map(written(tmp_path, "# strict: true\n" + header + body, "s.csv")).strict


def test_an_entry_of_a_quantity_is_for_that_quantity_alone() -> None:
    chosen = ChannelMap.of([
        {"node": 12, "direction": "z", "place": "hammer", "axis": "z", "quantity": "force"},
        {"node": 12, "direction": "z", "place": "tip", "axis": "z", "quantity": "acceleration", "unit": "g"},
    ])  # fmt: skip
    taken = record(Channel("12.z", "force", "N"), Channel("12.z", "acceleration", "g"))
    found = mapped_record(taken, chosen)
    assert found.channels == (Channel("hammer.z", "force", "N"), Channel("tip.z", "acceleration", "m/s²"))
    np.testing.assert_allclose(found.values, taken.values * [1, 9.80665], rtol=1e-15)  # one rounding
    with pytest.raises(DataFileError, match=r"channels, line 2: found '12.z' in a second entry"):
        chosen.place_of(12, 3, "12.z")


def test_a_label_tells_force_and_response_of_one_name_apart() -> None:
    chosen = ChannelMap.of([
        {"channel": "force:1", "place": "hammer", "axis": "x"},
        {"channel": "acceleration:1", "place": "tip", "axis": "x"},
    ])  # fmt: skip
    found = mapped_record(record(Channel("1", "force", "N"), Channel("1", "acceleration", "m/s²")), chosen)
    assert found.labels == ("force:hammer.x", "acceleration:tip.x")


def test_an_entry_may_do_for_force_and_response_alike() -> None:
    chosen = ChannelMap.of([{"node": 3, "place": "tip", "rotate": {"x": "y", "y": "-x"}}])
    frfs = FrfSet(np.array([1.0]), np.array([[[2j], [3.0]]]), "accelerance", ("3.x", "3.y"), ("3.y",))
    found = mapped_frfs(frfs, chosen)
    assert (found.outputs, found.inputs) == (("tip.y", "tip.x"), ("tip.x",))
    # x lies along y; y, both of response and of force, along −x.
    np.testing.assert_array_equal(found.values, [[[-2j], [3.0]]])


def test_frfs_are_scaled_by_the_response_and_divided_by_the_scale_of_the_force() -> None:
    chosen = ChannelMap.of([
        {"channel": "a.x", "place": "tip", "axis": "x", "unit": "g"},
        {"channel": "b.x", "place": "tip", "axis": "-x", "scale": 1000.0},
    ])  # fmt: skip
    frfs = FrfSet(
        np.array([1.0, 2.0]), np.array([[[2j]], [[1.0]]]), "accelerance", ("a.x",), ("b.x",),
        coherence=np.array([[[0.5]], [[0.25]]]), averages=np.array([[4]]), decay_rate=0.3, notes={"who": "me"},
    )  # fmt: skip
    found = mapped_frfs(frfs, chosen)
    np.testing.assert_allclose(found.values, frfs.values * (-9.80665 / 1000), rtol=1e-15)  # one rounding more
    np.testing.assert_array_equal(found.coherence, frfs.coherence)  # type: ignore[arg-type]
    assert (found.outputs, found.inputs, found.decay_rate, found.notes) == (("tip.x",), ("tip.x",), 0.3, {"who": "me"})


def test_shapes_of_modes_turn_their_signs_too() -> None:
    chosen = ChannelMap.of([
        {"node": 3, "direction": "z", "place": "tip", "axis": "-x", "quantity": "acceleration", "scale": 9.8},
        {"node": 3, "direction": "z", "place": "hammer", "axis": "x", "quantity": "force"},
    ])  # fmt: skip
    modes = ModeTable(np.array([-1 + 9j]), np.array([[1j, 2.0]]), ("3.z", "3.y"))
    found = mapped_modes(modes, chosen)
    assert found.coordinates == ("tip.x", "3.y")
    np.testing.assert_array_equal(found.shapes, [[-1j, 2.0]])  # type: ignore[arg-type]


def test_places_that_the_robot_has_no_frame_for_are_told_with_the_nearest(tmp_path: Path) -> None:
    robot = am.load("kuka_kr90")
    path = mapping(tmp_path, "{node: 1, place: sensor}", "{node: 2, place: sensr}", "{node: 3, place: zzz}")
    first, second = read_channel_map(path).check(robot)
    assert first.endswith(f"map.yaml, line 4: {robot.name} has no frame 'sensr'. Did you mean sensor?")
    assert second.endswith("has no frame 'zzz'.")


def test_entries_that_met_no_channel_are_told_and_a_fresh_map_begins_anew(tmp_path: Path) -> None:
    chosen = read_channel_map(mapping(tmp_path, '{channel: "Ch 1", place: tip, axis: x}', "{node: 4, place: tip}"))
    chosen.place_of(None, None, "Ch 1")
    (told,) = chosen.unmet()
    assert told.endswith("map.yaml, line 4: nothing that was read is node 4.")
    assert len(chosen.fresh().unmet()) == 2


def test_points_of_a_geometry_get_the_one_place_of_their_node() -> None:
    chosen = ChannelMap.of([
        {"node": 1, "direction": "x", "place": "tip", "axis": "x"}, {"node": 1, "direction": "y", "place": "tip"},
        {"node": 2, "direction": "x", "place": "a"}, {"node": 2, "direction": "y", "place": "b"},
    ])  # fmt: skip
    assert [chosen.point_of(node, str(node)) for node in (1, 2, 3)] == ["tip", "2", "3"]


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        (["{channel: a, plce: tip, axis: x}"], r"line 3, .*: found the unknown key 'plce', .* Did you mean place\?"),
        (["{channel: a, place: tip, axis: q}"], r"line 3, .*axis: found 'q', expected an axis x, y, z, rx, ry or rz"),
        (["{channel: a, place: tip, axis: 1}"], r"axis: found '1', .* Write it as text, such as '-z'"),
        (["{channel: a, place: tip}"], r"line 3, .*: found no axis"),
        (["{channel: a, axis: x}"], r"found no place, expected the name of a frame"),
        (["{place: tip, axis: x}"], r"found neither channel nor node"),
        (["{channel: a, node: 3, place: tip, axis: x}"], r"found both channel and node"),
        (["{channel: a, direction: x, place: tip, axis: x}"], r"found the direction of a channel"),
        (["{node: 3, place: tip, axis: x}"], r"found one axis for a whole node, .* turn all of its axes with rotate"),
        (["{node: 3, direction: x, rotate: {x: y}, place: tip}"], r"found rotate for one channel"),
        (["{node: -3, place: tip}"], r"node: found '-3', expected the number of a node"),
        (["{node: true, place: tip}"], r"node: found 'True'"),
        (["{node: 3, direction: x, axis: rx, place: tip}"], r"expected both translations, or both rotations"),
        (["{node: 3, place: tip, rotate: {x: z}}"], r"found two axes that fall on one \(x: z, y: y, z: z\)"),
        (["{node: 3, place: tip, rotate: {x: z, z: x}}"], r"found a mirror image of the axes, expected a rotation"),
        (["{node: 3, place: tip, rotate: {rx: y}}"], r"rotate: found rx: y, expected x, y or z each"),
        (["{node: 3, place: tip, rotate: z}"], r"rotate: found 'z', expected axes by axis"),
        (["{channel: a, place: tip, axis: x, quantity: acelleration}"], r"Did you mean acceleration\?"),
        (["{channel: a, place: tip, axis: x, scale: -2}"], r"expected a positive factor. A sign belongs to the axis"),
        (["{channel: a, place: tip, axis: x, scale: .nan}"], r"scale: found 'nan'"),
        (["{channel: a, place: tip, axis: x, unit: g, scale: 9.81}"], r"found the unit g and the factor 9.81 that"),
        (["{channel: a, place: tip, axis: x, quantity: force, unit: g}"], r"unit: found the unit g of force"),
        (["{channel: a, place: tip, axis: x}", "{channel: a, place: b, axis: x}"],
         r"line 4: found channel 'a' in a second entry, expected one .*first on line 3"),
        (["{node: 3, place: a}", "{node: 3, direction: -y, place: b}"], r"line 4: found node 3 along y in a second"),
        (["5"], r"line 3, channels\[0\]: found '5', expected an entry such as"),
    ],
)  # fmt: skip
def test_an_entry_that_makes_no_sense_is_refused_by_its_line(tmp_path: Path, entries: list[str], said: str) -> None:
    with pytest.raises(DataFileError, match=said):
        read_channel_map(mapping(tmp_path, *entries))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", r"found an empty file, expected a channel map that starts with `armonic_channels: 1`"),
        ("channels: []\n", r"found no armonic_channels"),
        ("armonic_channels: 2\nchannels: []\n", r"line 1, armonic_channels: found armonic_channels: '2'"),
        ("armonic_channels: 1\n", r"found no channels, expected a list of entries"),
        ("armonic_channels: 1\nchanels: []\n", r"line 2, chanels: found the unknown key .*Did you mean channels\?"),
        ("armonic_channels: 1\nstrict: 5\nchannels: [{}]\n", r"line 2, strict: found '5', expected true or false"),
        ("armonic_channels: 1\nchannels: [{node: 1\n", r"line 2, .*: found a syntax error"),
        (
            "armonic_channels: 1\nchannels: [!!python/object:os.system {}]\n",
            r"found the YAML tag .*a channel map holds",
        ),
        ("[1, 2]\n", r"expected a channel map that starts"),
    ],
)
def test_a_file_that_is_no_map_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DataFileError, match=said):
        read_channel_map(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# nothing\n", r"found no table"),
        ("channel,place,axes\na,b,x\n", r"line 1: found column 'axes', .* Did you mean axis\?"),
        ("channel,place,channel\na,b,x\n", r"found column 'channel' twice"),
        ("channel,place,axis\n", r"found a header and no entry"),
        ("channel,place,axis\na,b\n", r"line 2: found 2 values, expected 3"),
        ("channel,place,axis\n\na,b,q\n", r"line 3, axis: found 'q'"),
        ('channel,place,axis\n"a,b,x\n', r"line 2: found a line that cannot be split"),
        ("node,direction,place,axis\n12,x,tip,y\n12,-x,tip,z\n", r"line 3: found node 12 along x in a second entry"),
    ],
)
def test_a_table_that_is_no_map_is_refused_by_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DataFileError, match=said):
        read_channel_map(written(tmp_path, text, "map.csv"))


def test_a_map_that_is_not_there_is_told_as_one(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match=r"none.yaml: found no file there, expected a channel map"):
        read_channel_map(tmp_path / "none.yaml")


def test_two_channels_on_one_degree_of_freedom_are_refused_with_both_lines(tmp_path: Path) -> None:
    path = mapping(tmp_path, "{channel: a, place: tip, axis: x}", "{channel: b, place: tip, axis: -x}")
    chosen = read_channel_map(path)
    with pytest.raises(DataFileError, match=r"'a' \(.*line 3\) and 'b' \(.*line 4\) both mapped onto force:tip.x"):
        mapped_record(record(Channel("a", "force", "N"), Channel("b", "force", "N")), chosen)
    # A force and a response at one place are what a driving point has.
    assert len(mapped_record(record(Channel("a", "force", "N"), Channel("b", "velocity", "m/s")), chosen).channels) == 2
    with pytest.raises(DataFileError, match=r"'a' \(.*line 3\) and 'tip.x' \(in no entry\)"):
        mapped_record(record(Channel("a", "force", "N"), Channel("tip.x", "force", "N")), chosen)


@pytest.mark.parametrize(
    ("unit", "factor", "si"),
    [
        ("g", 9.80665, "m/s²"), ("mm/s^2", 1e-3, "m/s²"), ("m/s**2", 1.0, "m/s²"), ("µm", 1e-6, "m"), ("μm", 1e-6, "m"),
        ("kN", 1e3, "N"), ("lbf", 0.45359237 * 9.80665, "N"), ("in/s", 0.0254, "m/s"), ("deg", np.pi / 180, "rad"),
    ],
)  # fmt: skip
def test_usual_units_are_known(unit: str, factor: float, si: str) -> None:
    found = si_unit(unit)
    assert found is not None
    assert (found.unit, found.factor) == (si, pytest.approx(factor, rel=1e-15))


@pytest.mark.parametrize("unit", ["V", "", "MN", "mn", "m²"])
def test_units_that_could_be_anything_are_not_guessed(unit: str) -> None:
    assert si_unit(unit) is None


def test_what_is_done_about_units_is_remarked() -> None:
    remarks: list[str] = []
    taken = record(
        Channel("tip.x", "acceleration", "g"), Channel("tip.y", "acceleration", ""),
        Channel("tip.z", "acceleration", "V"),
        Channel("Ch 4", "signal", "mm/s"), Channel("Ch 5", "signal"), Channel("tip.x", "force", "m"),
    )  # fmt: skip
    found = mapped_record(taken, remarks=remarks)
    assert [c.unit for c in found.channels] == ["m/s²", "m/s²", "V", "m/s", "", "m"]
    assert found.channels[3].quantity == "velocity"
    np.testing.assert_allclose(found.values, taken.values * [9.80665, 1, 1, 1e-3, 1, 1], rtol=1e-15)  # one rounding
    assert remarks == [
        "acceleration:tip.x was converted from g to m/s², by 9.80665.",
        "acceleration:tip.z is in V, which is not converted: a channel map can give its scale.",
        "velocity:Ch 4 was converted from mm/s to m/s, by 0.001.",
        "force:tip.x is said to be in m, a unit of displacement: its numbers are kept.",
        "No unit is stated of acceleration:tip.y: the numbers are taken for SI.",
        "Nothing says what Ch 5 holds: a channel map can.",
    ]


def test_a_scale_of_the_map_leads_to_si_whatever_the_file_says() -> None:
    chosen = ChannelMap.of([
        {"channel": "Ch 1", "place": "tip", "axis": "x", "quantity": "acceleration", "scale": 98.0665},
        {"channel": "Ch 2", "place": "tip", "axis": "x", "quantity": "force", "scale": 0.1, "unit": "kN"},
    ])  # fmt: skip
    remarks: list[str] = []
    taken = record(Channel("Ch 1", "signal", "V"), Channel("Ch 2", "signal", "V"))
    found = mapped_record(taken, chosen, remarks=remarks)
    assert found.channels == (Channel("tip.x", "acceleration", "m/s²"), Channel("tip.x", "force", "N"))
    np.testing.assert_allclose(found.values, taken.values * [98.0665, 100], rtol=1e-15)  # one rounding
    assert not remarks


def test_values_that_are_not_finite_are_kept() -> None:
    taken = record(Channel("tip.x", "acceleration", "g")).with_values([[np.nan], [np.inf], [1.0]])
    np.testing.assert_array_equal(mapped_record(taken).values, [[np.nan], [np.inf], [9.80665]])
