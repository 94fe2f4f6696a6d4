"""The command line: what it prints for people and machines, what it writes, and that it starts fast."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.cli import demo
from command_line import EXAMPLES, MEASURED, START, TRUE, WIDTH, Armonic, Run, files
from published import HUYNH_3R, KUKA_KR90

PLANAR = """\
armonic: 1
name: planar
links:
  - {name: upper, parent: base, placement: [{rx: 90 deg}], joint: {type: revolute, axis: z},
     elasticity: {z: {stiffness: 1e5, damping: 30}}, mass: 10, com: [0.4, 0, 0], inertia: {xx: 0.1, yy: 0.5, zz: 0.5}}
  - {name: lower, parent: upper, placement: [{x: 0.8}], joint: {type: revolute, axis: z},
     elasticity: {z: {stiffness: 1e5, damping: 30}}, mass: 10, com: [0.4, 0, 0], inertia: {xx: 0.1, yy: 0.5, zz: 0.5}}
frames:
  - {name: tip, link: lower, placement: [{x: 0.8}, {rx: -90 deg}]}
postures: {bent: [0.3, 0.7]}
"""
"""Moves in the x-z plane; along y the tip stands still but for rounding."""


def process(*words: str, code: str | None = None) -> subprocess.CompletedProcess[str]:
    start = ["-m", "armonic", *words] if code is None else ["-c", code]
    return subprocess.run([sys.executable, *start], capture_output=True, text=True, check=False)


def test_modes_prints_the_published_frequencies_and_what_moves(armonic: Armonic) -> None:
    run = armonic("modes", "kuka_kr90", "--posture", "milling")
    rows = [line.split() for line in run.out.splitlines() if line[:1].isdigit()]
    damped, damping = ([float(row[k]) for row in rows] for k in (2, 3))
    # Half a unit of the last printed digit on either side.
    np.testing.assert_allclose(damped, KUKA_KR90.all_damped_freq_hz_earlier_work, atol=0.0101)
    np.testing.assert_allclose(damping[:4], 100 * np.array(KUKA_KR90.modes_earlier_work.damping_ratio), atol=0.0101)
    assert "arm.z 90 %" in run.words
    assert "Asymptotically stable" in run.words


def test_modes_as_json_holds_poles_shapes_and_shares(armonic: Armonic) -> None:
    data = armonic("modes", "huynh_3r", "--json").json
    assert (data["posture"], data["stability"]) == ("milling", "asymptotically stable")
    modes = data["modes"]
    # The recomputed table carries five digits.
    np.testing.assert_allclose([m["natural_freq_hz"] for m in modes], HUYNH_3R.natural_freq_hz, rtol=1e-4)
    np.testing.assert_allclose([m["damping_ratio"] for m in modes], HUYNH_3R.modes.damping_ratio, rtol=1e-3)
    assert all(len(m["shape"]["re"]) == len(m["shape"]["im"]) == 3 for m in modes)
    assert all(sum(m["participation"].values()) == pytest.approx(1) for m in modes)


def test_a_posture_may_be_typed_as_numbers_with_units(armonic: Armonic) -> None:
    named, typed = (
        armonic("modes", "kuka_kr90", "--posture", p, "--json").json for p in ("milling", "0, 70deg,-100 deg")
    )
    assert typed["modes"] == named["modes"]
    assert typed["posture"] == "0,70deg,-100deg"


def test_a_weight_at_the_sensor_moves_the_static_equilibrium_and_the_modes(armonic: Armonic) -> None:
    words = ("modes", "huynh_3r", "--json", "--wrench", "0,0,-5000,0,0,0")
    reference, static = (armonic(*words, "--equilibrium", how).json for how in ("reference", "static"))
    assert reference["frame"] == "sensor"
    assert static["modes"][0]["natural_freq_hz"] != reference["modes"][0]["natural_freq_hz"]


def test_frf_writes_what_the_library_computes(armonic: Armonic, tmp_path: Path) -> None:
    lines = np.array([5.0, 5.1, 5.2, 5.3])
    expected = am.frf(
        am.load("huynh_3r"), "milling", lines, frame="sensor", kind="receptance", outputs="x", inputs="yz"
    )
    for name, binary in (("a.uff", ()), ("b.uff", ("--binary",)), ("c.csv", ())):
        path = tmp_path / name
        words = ("frf", "huynh_3r", "-o", path, "--freq", "5:5.3:0.1", "--kind", "receptance")
        run = armonic(*words, "--outputs", "x", "--inputs", "yz", *binary)
        assert (run.code, run.err) == (0, "")
        assert run.out.startswith(f"Wrote {path}:")
        written = am.read_frf(path)
        assert (written.kind, written.frame, written.outputs, written.inputs) == (
            "receptance",
            "sensor",
            ("x",),
            ("y", "z"),
        )
        np.testing.assert_allclose(written.freq_hz, lines, rtol=1e-15)
        np.testing.assert_allclose(written.values, expected.values, rtol=1e-12)  # 13 digits in text


def test_the_highest_peak_that_frf_prints_lies_at_a_published_mode(armonic: Armonic) -> None:
    data = armonic("frf", "huynh_3r", "--json", "--freq", "0.1:30:0.01").json
    highest = max(data["peaks"], key=lambda peak: peak["magnitude"])
    assert (highest["output"], highest["input"]) == ("z", "z")
    # At 1.7 % damping an accelerance peaks within a few 0.01 % of the natural frequency.
    assert highest["freq_hz"] == pytest.approx(HUYNH_3R.natural_freq_hz[2], rel=2e-3)
    assert np.shape(data["re"]) == np.shape(data["im"]) == (2991, 3, 3)


def test_frf_says_which_modes_its_default_lines_leave_out_and_how_to_see_them(armonic: Armonic) -> None:
    above = sum(hz > 30 for hz in KUKA_KR90.all_damped_freq_hz_earlier_work)
    last = armonic("frf", "kuka_kr90").out.splitlines()[-1]
    assert last.startswith(f"{above} of 9 modes lie above 30 Hz: see them with --freq ")
    start, stop, step = map(float, last.split()[-1].split(":"))
    assert start == step
    assert max(KUKA_KR90.all_damped_freq_hz_earlier_work) < stop
    assert stop / step < 1000  # no flood of lines
    assert armonic("frf", "kuka_kr90", "--freq", last.split()[-1]).code == 0
    # No word where all are seen, and where somebody chose the lines.
    for words in (("huynh_3r",), ("kuka_kr90", "--freq", "1:9:1")):
        assert "above" not in armonic("frf", *words).out


def test_frf_prints_no_peaks_of_a_response_that_is_zero(armonic: Armonic, tmp_path: Path) -> None:
    (tmp_path / "planar.yaml").write_text(PLANAR, "utf-8")
    words = ("frf", tmp_path / "planar.yaml", "--freq", "0.5:30:0.5")
    rows = {row[0]: row[1:] for row in map(str.split, armonic(*words).out.splitlines()) if row and "/" in row[0]}
    assert all(rows[f"{a}/{b}"] == ["–"] * 3 for a, b in ("xy", "yx", "yy", "yz", "zy"))
    assert rows["x/x"][1] == "at"
    peaks = armonic(*words, "--json").json["peaks"]
    assert {peak["output"] + peak["input"] for peak in peaks} <= {"xx", "xz", "zx", "zz"}


def test_frf_prints_the_values_at_a_single_line(armonic: Armonic, tmp_path: Path) -> None:
    (tmp_path / "planar.yaml").write_text(PLANAR, "utf-8")
    run = armonic("frf", tmp_path / "planar.yaml", "--freq", "10:10:1", "--kind", "receptance")
    rows = {row[0]: row[1:] for row in map(str.split, run.out.splitlines()) if row and "/" in row[0]}
    robot = am.load(tmp_path / "planar.yaml")
    # The response to a unit force from the mass, damping and stiffness matrices, solved as equations.
    model, w = am.linearize(robot, "bent"), 2 * np.pi * 10
    dynamic = model.stiffness + 1j * w * model.damping - w**2 * model.mass
    along_x = model.jacobian("tip")[0]
    value = along_x @ np.linalg.solve(dynamic, along_x)
    assert "at 10 Hz" in run.words
    assert float(rows["x/x"][0]) == pytest.approx(abs(value), rel=6e-3)  # three digits are printed
    assert float(rows["x/x"][1].removesuffix("°")) == pytest.approx(np.degrees(np.angle(value)), abs=0.051)
    assert rows["x/y"] == ["–", "–"]


def test_demo_fits_the_kuka_and_says_how_to_do_it_by_hand(armonic: Armonic, tmp_path: Path) -> None:
    into = tmp_path / "my demo"
    for _ in range(2):  # a second demo in the same place is fine
        run = armonic("demo", "--into", into)
        assert (run.code, run.err) == (0, "")
    shipped = ["kuka_milling.uff", "kuka_start.yaml", "kuka_true.yaml", "taps.uff"]
    assert files(into) == sorted([*shipped, demo.MAP, demo.REPORT, demo.ROBOT])
    assert "true" in run.words
    assert "armonic update" in run.words
    modes = am.modes(am.load(into / demo.ROBOT), "milling")
    # 1 % of noise; the fit of the paper to its own synthesized data comes within 0.1 Hz.
    np.testing.assert_allclose(modes.damped_freq_hz[:4], KUKA_KR90.modes_earlier_work.damped_freq_hz, atol=0.03)


def test_demo_as_json_gives_each_parameter_its_true_value(armonic: Armonic, tmp_path: Path) -> None:
    parameters = armonic("demo", "--into", tmp_path, "--json").json["parameters"]
    true = {p["path"]: p["true"] for p in parameters}
    springs = KUKA_KR90.earlier_work
    keys = [f"links.{link}.elasticity.{axis}" for link in KUKA_KR90.links for axis in KUKA_KR90.keys]
    expected = {f"{key}.stiffness": k for key, k in zip(keys, springs.stiffness, strict=True)}
    expected |= {f"{key}.damping": d for key, d in zip(keys, springs.damping, strict=True)}
    assert true == pytest.approx(expected)


def test_the_example_measurement_is_the_truth_with_one_percent_noise() -> None:
    measured, true = am.read_frf(MEASURED), am.load(TRUE)
    assert (measured.kind, measured.frame, measured.values.shape) == ("accelerance", "sensor", (150, 3, 3))
    np.testing.assert_allclose(measured.freq_hz, 0.2 * np.arange(1, 151), rtol=1e-12)
    exact = am.frf(true, "milling", measured.freq_hz, frame="sensor").values
    error = (measured.values / exact - 1).ravel()
    for part in (error.real, error.imag):
        # 1350 normal numbers give their deviation to 1/sqrt(2700) = 2 %, and their mean to 3 % of it.
        assert part.std() == pytest.approx(0.01, rel=0.08)
        assert abs(part.mean()) < 0.0011
        assert np.abs(part).max() < 0.05


def test_the_example_is_made_from_the_catalog_byte_for_byte(tmp_path: Path) -> None:
    script = Path(__file__).parents[1] / "examples" / "make_kuka.py"
    subprocess.run([sys.executable, str(script), str(tmp_path)], check=True)
    for name in ("kuka_milling.uff", "kuka_true.yaml"):
        assert (tmp_path / name).read_bytes() == (EXAMPLES / name).read_bytes()
    assert Path(TRUE).read_bytes() == (EXAMPLES.parent / "catalog" / "kuka_kr90.yaml").read_bytes()


def test_robots_lists_the_catalog(armonic: Armonic) -> None:
    robots = {robot["name"]: robot for robot in armonic("robots", "--json").json["robots"]}
    assert (len(robots["huynh_3r"]["coordinates"]), len(robots["kuka_kr90"]["coordinates"])) == (3, 9)
    assert "huynh_3r" in armonic("robots").words


def test_check_has_nothing_to_say_of_a_good_file_and_prints_findings_of_others(
    armonic: Armonic, tmp_path: Path
) -> None:
    assert armonic("check", "kuka_kr90").code == 0
    text = Path(TRUE).read_text("utf-8")
    doubtful, wrong, invalid = (tmp_path / name for name in ("doubtful.yaml", "wrong.yaml", "invalid.yaml"))
    doubtful.write_text(text.replace("xx: 45.88, yy: 125.93", "xx: 4.88, yy: 5.93"), "utf-8")
    wrong.write_text(text.replace("xx: 45.88", "xx: -45.88"), "utf-8")
    invalid.write_text(text.replace("mass: 222.659", "mass: -1"), "utf-8")

    run = armonic("check", doubtful)
    assert (run.code, run.err) == (0, "")
    assert "triangle inequality" in run.words
    assert [f["level"] for f in armonic("check", doubtful, "--json").json["findings"]] == ["warning"]
    assert armonic("check", wrong).error
    assert "mass" in armonic("check", invalid).error


def test_check_lists_every_error_of_an_invalid_file_in_its_order(armonic: Armonic, tmp_path: Path) -> None:
    text = Path(TRUE).read_text("utf-8").replace("mass: 222.659", "mass: -1").replace("type: revolute", "type: rotary")
    invalid = tmp_path / "invalid.yaml"
    invalid.write_text(text, "utf-8")
    lines = [i for i, row in enumerate(text.splitlines(), 1) if "rotary" in row or "mass: -1" in row]
    run = armonic("check", invalid)
    assert run.error == f"error: {invalid}: 4 errors found."
    places = [row.split()[2].rstrip(",") for row in run.out.splitlines() if row.startswith("error")]
    assert places == [str(line) for line in lines]
    assert "more error" not in run.words  # they are all there
    run = armonic("check", invalid, "--json")
    assert run.error
    data = Run(0, run.out, "").json
    assert data["ok"] is False
    assert [f["where"].partition(",")[0] for f in data["findings"]] == [f"line {line}" for line in lines]


@pytest.mark.parametrize(
    "words", [(), ("--help",), *((c, "--help") for c in ("modes", "frf", "export", "map", "update", "check", "demo"))]
)
def test_help_fits_80_columns_and_says_how_to_go_on(armonic: Armonic, words: tuple[str, ...]) -> None:
    run = armonic(*words)
    assert (run.code, run.err) == (0, "")
    assert run.out.startswith("Usage: armonic")
    assert "..." not in run.out.partition("Commands:")[2]  # no summary cut short
    assert max(map(len, run.out.splitlines())) <= WIDTH


def test_every_table_fits_80_columns(armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # lines with paths are never broken, and those of the test are long
    outputs = [
        armonic("modes", "kuka_kr90"),
        armonic("frf", "kuka_kr90"),
        armonic("frf", "huynh_3r", "--outputs", "x,y,z,rx,ry,rz", "--inputs", "x,rz"),
        armonic("robots"),
        armonic("check", START),
        armonic("demo"),
    ]
    for run in outputs:
        assert (run.code, run.err) == (0, "")
        assert max(map(len, run.out.splitlines())) <= WIDTH


def test_version_is_that_of_the_package(armonic: Armonic) -> None:
    assert armonic("--version") == Run(0, f"armonic {version('armonic')}\n", "")


def test_python_m_armonic_is_the_command() -> None:
    done = process("modes", "huynh_3r", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert '"asymptotically stable"' in done.stdout
    done = process("modes", "nobody")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("statement", "barred"),
    [
        ("import armonic", "plotly scipy pydantic ruamel rich typer pyuff jinja2"),
        ("import armonic.cli", "typer numpy"),
        ("from armonic.cli import main; main(['modes', 'kuka_kr90'])", "plotly scipy pyuff jinja2"),
        (
            "from armonic.cli import main; main(['modes', 'kuka_kr90', '--json'])",
            "rich plotly scipy pyuff jinja2",
        ),
        ("from armonic.cli import main; main(['--version'])", "numpy"),
    ],
)
def test_nothing_heavy_is_imported_before_it_is_needed(statement: str, barred: str) -> None:
    code = f"import sys; {statement}; print([n for n in {barred.split()} if n in sys.modules], file=sys.stderr)"
    done = process(code=code)
    assert (done.returncode, done.stderr) == (0, "[]\n")
