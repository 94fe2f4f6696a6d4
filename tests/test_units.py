"""Numbers with units."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armonic.description.units import UNITS, quantity
from armonic.errors import RobotFileError


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("350 mm", "length", 0.35),
        ("-2.5cm", "length", -0.025),
        ("12 µm", "length", 12e-6),
        ("180 deg", "angle", math.pi),
        ("90°", "angle", math.pi / 2),
        ("60 arcmin", "angle", math.pi / 180),
        ("5 mrad", "angle", 0.005),
        (".5 t", "mass", 500.0),
        ("250 g", "mass", 0.25),
        ("3 kg mm^2", "inertia", 3e-6),
        ("3 kg·mm²", "inertia", 3e-6),
        ("2e4 kg*cm**2", "inertia", 2.0),
        ("9810 mm/s²", "acceleration", 9.81),
        ("2.8 MN m/rad", "rotational stiffness", 2.8e6),
        ("2.8 MN·m / rad", "rotational stiffness", 2.8e6),
        ("2.8 MNm/rad", "rotational stiffness", 2.8e6),
        ("1 N m/arcmin", "rotational stiffness", 60 * 180 / math.pi),
        ("2 N m/mrad", "rotational stiffness", 2000.0),
        ("1.5 kN/mm", "translational stiffness", 1.5e6),
        ("3 N/um", "translational stiffness", 3e6),
        ("0.4 kN m s/rad", "rotational damping", 400.0),
        ("7 Nms/rad", "rotational damping", 7.0),
        ("7 N s/mm", "translational damping", 7000.0),
        ("+1E1 N", "coupling stiffness", 10.0),
    ],
)
def test_quantities_have_the_value_worked_out_by_hand(text, dimension, value) -> None:
    assert quantity(text, dimension) == pytest.approx(value, rel=1e-15)  # one rounded product


@given(st.sampled_from([(d, u) for d, table in UNITS.items() for u in table]), st.floats(-1e6, 1e6))
def test_every_unit_scales_its_number(entry, figure) -> None:
    dimension, unit = entry
    assert quantity(f"{figure!r} {unit}", dimension) == figure * UNITS[dimension][unit]


@pytest.mark.parametrize(
    ("text", "dimension", "hint"),
    [
        ("5 kg", "length", "'kg' measures mass"),
        ("5 rad", "length", "'rad' measures an angle"),
        ("5 N/m", "rotational stiffness", "measures translational stiffness"),
        ("5 furlong", "length", "'furlong' is not known"),
        ("5 mN m/rad", "rotational stiffness", "not known"),
        ("5 m m", "length", "not known"),
        ("1,5 m", "length", "decimal point"),
        ("5", "length", "without quotes if it is in m"),
        ("five m", "length", None),
        ("", "length", None),
        ("1e999 m", "length", None),
        ("nan m", "length", None),
    ],
)
def test_bad_quantities_say_what_is_accepted(text, dimension, hint) -> None:
    with pytest.raises(RobotFileError) as caught:
        quantity(text, dimension)
    assert caught.value.found == repr(text)
    if "999" not in text:
        assert all(unit in caught.value.expected for unit in UNITS[dimension])
    assert caught.value.hint is None if hint is None else hint in caught.value.hint
