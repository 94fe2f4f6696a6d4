"""`armonic ema` from the shipped taps to modes, files and a report, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic import examples
from command_line import Armonic

TAPS = Path(examples.__file__).parent / examples.TAPS
FRFS = Path(examples.__file__).parent / examples.MEASURED
FAST = ("--band", "5:40", "--orders", "2:40")


def test_the_taps_that_ship_give_the_modes_of_the_robot(armonic: Armonic, empty_folder: Path) -> None:
    run = armonic(
        "ema", TAPS, *FAST, "-o", "modes.csv", "--report", "ema.html", "--synthesized", "s.uff", "--frfs", "f.h5"
    )
    assert run.code == 0
    assert "13 hits of 15 used" in run.out
    assert "a double hit" in run.out
    assert "force:sensor.z is overloaded" in run.out
    assert max(map(len, run.out.splitlines())) <= 80
    true = am.modes(am.load("kuka_kr90"), "milling")
    table = np.loadtxt("modes.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:4, 0], true.natural_freq_hz[:4], rtol=0.005)  # joints soften by 0.8 %
    page = Path("ema.html").read_text("utf-8")
    assert "a double hit" in page
    assert "Not read" not in page
    made = am.read_measured("s.uff").frfs
    assert made is not None
    np.testing.assert_allclose(made.values, made.values.swapaxes(1, 2))  # average of the cross responses
    estimated = am.read_measured("f.h5").frfs
    assert estimated is not None
    assert estimated.averages is not None
    assert sorted(np.unique(estimated.averages)) == [4, 5]


def test_the_same_for_machines_and_modes_as_a_universal_file(armonic: Armonic, empty_folder: Path) -> None:
    run = armonic("ema", FRFS, "--json", "-o", "modes.uff")
    data = json.loads(run.out)
    assert run.code == 0
    assert [len(mode["shape"]["re"]) for mode in data["modes"]] == [3] * len(data["modes"])
    read = am.read_measured("modes.uff").modes
    assert read is not None
    np.testing.assert_allclose(read.natural_freq_hz, [mode["natural_freq_hz"] for mode in data["modes"]], rtol=1e-6)


def test_a_band_without_a_mode_says_so(armonic: Armonic) -> None:
    run = armonic("ema", TAPS, "--band", "30:34")
    assert run.code == 0
    assert "nothing held over enough orders" in run.out
    refused = armonic("update", "kuka_kr90", TAPS, "--synthesize", "--band", "30:34")
    assert refused.code == 2
    assert "found no mode in its responses" in refused.err


def test_hits_are_kept_by_their_numbers(armonic: Armonic) -> None:
    data = json.loads(armonic("ema", TAPS, *FAST, "--keep", "1,2,6,11", "--json").out)
    assert [k for k, hit in enumerate(data["hits"], 1) if hit["used"]] == [1, 2, 6, 11]


def test_what_is_left_of_a_file_that_was_cut_is_used(armonic: Armonic, empty_folder: Path) -> None:
    Path("cut.uff").write_bytes(TAPS.read_bytes()[:500_000])
    run = armonic("ema", "cut.uff", *FAST)
    assert run.code == 0
    assert "not read: data set" in run.out
    assert "Record 8 is left out: no response among" in " ".join(run.out.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("ema",), "Missing argument 'FILE...'"),
        (("ema", "nothing.uff"), "nothing.uff: found No such file"),
        (("ema", "page.html"), "found the ending '.html'"),
        (("ema", TAPS, "--keep", "99"), "--keep: found '99', expected numbers of usable hits, counted from 1"),
        (("ema", TAPS, "--keep", "one"), "--keep: found 'one'"),
        (("ema", TAPS, "--orders", "5"), "--orders: found '5', expected LOW:HIGH"),
        (("ema", TAPS, "--orders", "9:5"), "the lowest order first"),
        (("ema", TAPS, "--band", "500:600"), "--band: found no line from 500 to 600 Hz"),
        (("ema", TAPS, "--resolution", "0.01"), "--resolution: found 100 s"),
        (("ema", TAPS, "--decay", "much"), "--decay: found 'much'"),
        (("ema", TAPS, "--method", "x"), "--method: found 'x', expected one of plscf, lsce"),
        (("ema", TAPS, "--estimator", "H9"), "--estimator: found 'H9'"),
        (("ema", TAPS, "--posture", "milling", "--robot", "nobody"), "nobody: found no file there"),
        (("ema", TAPS, "-o", "modes.xml"), "found the ending '.xml'"),
        (("ema", FRFS, "--decay", "3"), "--decay: found it with"),
        (("ema", FRFS, "--posture", "milling"), "--posture: found it without a robot"),
        (("update", "kuka_kr90", TAPS, "--kind", "mobility"), "--kind: found it with taps.uff"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_is_written(
    armonic: Armonic, empty_folder: Path, words: tuple[str, ...], said: str
) -> None:
    run = armonic(*words)
    assert run.code == 2
    assert said in run.err
    assert len(run.err.splitlines()) == 1
    assert not list(empty_folder.iterdir())


def test_modes_written_to_a_universal_file_are_fitted_with_their_shapes(armonic: Armonic, empty_folder: Path) -> None:
    assert armonic("ema", TAPS, *FAST, "-o", "modes.uff").code == 0
    run = armonic("update", "kuka_kr90", "--modes", "modes.uff", "--hold", "*damping", "-o", "new.yaml", "--json")
    assert run.code == 0, run.err
    found = am.read_measured("modes.uff").modes
    assert found is not None
    updated = am.modes(am.load("new.yaml"), "milling")
    np.testing.assert_allclose(updated.natural_freq_hz[:4], found.natural_freq_hz[:4], rtol=0.005)  # its deviation
    refused = armonic("update", "kuka_kr90", "--modes", FRFS, "-o", "none.yaml")
    assert refused.code == 2
    assert "found no modes" in refused.err
