"""`armonic update` with coherence beside the responses, and with tables of modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from command_line import TRUE, WIDTH, Armonic, files
from update_files import EXACT, PATTERN, fitted, measure, off

pytestmark = pytest.mark.usefixtures("empty_folder")


# Coherence


def test_lines_without_coherence_count_for_nothing(armonic: Armonic) -> None:
    true = am.load(TRUE)
    frf = measure(true, "clean.csv")
    values, good = frf.values.copy(), np.full(frf.values.shape, 0.99)
    values[30:40, 0, 1], good[30:40, 0, 1] = 5.0, 0.0
    am.write_frf("m.csv", replace(frf, values=values))
    write_coherence("c.csv", frf, good)
    words = ("update", off(true, PATTERN), "m.csv", "-o", "new.yaml", "--force", "--parameters", PATTERN)
    assert armonic(*words).code == 0
    assert fitted() != pytest.approx(true.parameters(PATTERN), rel=1e-3)
    for more in ((), ("--band", "2:29"), ("--outputs", "xz", "--inputs", "yz"), ("--responses", "x/y,z/z")):
        assert armonic(*words, "--coherence", "c.csv", *more).code == 0
        assert fitted() == pytest.approx(true.parameters(PATTERN), rel=EXACT)


def test_coherence_belongs_to_its_file_and_its_lines(armonic: Armonic, tmp_path: Path) -> None:
    frf = measure(am.load(TRUE), "m.csv")
    write_coherence("c.csv", frf, np.ones(frf.values.shape))
    words = ("update", TRUE, "m.csv", "-o", "new.yaml", "--parameters", PATTERN)
    assert "found 2 of them, expected as many" in armonic(*words, "--coherence", "c.csv", "--coherence", "c.csv").error
    both = ("update", TRUE, "m.csv", "m.csv", *words[3:], "--coherence", "c.csv")
    assert "--coherence: found 1 of them" in armonic(*both).error
    assert "--symmetrize as well" in armonic(*words, "--coherence", "c.csv", "--symmetrize", "average").error
    few = frf.select(outputs="x", inputs="x")
    write_coherence("few.csv", few, np.ones(few.values.shape))
    assert "found no coherence of x/y" in armonic(*words, "--coherence", "few.csv").error
    short = frf.band(2, 20)
    write_coherence("short.csv", short, np.ones(short.values.shape))
    assert "found no coherence of x/x at 0.4 Hz" in armonic(*words, "--coherence", "short.csv").error
    assert armonic(*words, "--coherence", "short.csv", "--band", "3:18").code == 0
    (tmp_path / "new.yaml").unlink()
    assert "expected a coherence from 0 to 1" in armonic(*words, "--coherence", wrong(frf)).error
    assert "nobody.csv" in armonic(*words, "--coherence", "nobody.csv").error


def write_coherence(name: str, frf: am.Frf, values: np.ndarray) -> None:
    pairs = [f"{a}/{b}" for a in frf.outputs for b in frf.inputs]
    rows = np.column_stack([frf.freq_hz, values.reshape(len(frf.freq_hz), -1)])
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    Path(name).write_text(f"# coherence\nfreq_hz,{','.join(pairs)}\n{text}\n", "utf-8")


def wrong(frf: am.Frf) -> str:
    write_coherence("wrong.csv", frf, np.full(frf.values.shape, 99.0))  # percent
    return "wrong.csv"


# Modes


def write_modes(name: str, robot: am.Robot, posture: str | list[float], columns: str, more: str = "") -> str:
    modes = am.modes(robot, posture)
    known = {
        "natural_freq_hz": modes.natural_freq_hz,
        "damped_freq_hz": modes.damped_freq_hz,
        "damping_ratio": modes.damping_ratio,
        "damping_percent": 100 * modes.damping_ratio,
    }
    rows = np.column_stack([known[column] for column in columns.split(",")]).tolist()
    extra = [",0.001" for _ in rows] if more else [""] * len(rows)
    text = "\n".join(",".join(map(repr, row)) + end for row, end in zip(rows, extra, strict=True))
    Path(name).write_text(f"{columns}{',' + more if more else ''}\n{text}\n", "utf-8")
    return name


@pytest.mark.parametrize(
    "columns", ["natural_freq_hz", "natural_freq_hz,damping_ratio", "damped_freq_hz,damping_percent"]
)
def test_modes_alone_can_be_fitted(armonic: Armonic, tmp_path: Path, columns: str) -> None:
    true = am.load(TRUE)
    pattern = "links.*.elasticity.z.stiffness" + (
        ",links.link_arm.elasticity.*.damping" if "damping" in columns else ""
    )
    write_modes("modes.csv", true, "milling", columns, "freq_deviation")
    words = ("update", off(true, pattern, 1.1), "--modes", "modes.csv", "-o", "new.yaml", "--parameters", pattern)
    run = armonic(*words, "--report", "r.html")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    assert "times the deviations that were stated" in run.words
    assert fitted(pattern=pattern) == pytest.approx(true.parameters(pattern), rel=1e-5)
    assert files(tmp_path) == ["modes.csv", "new.yaml", "off.yaml", "r.html"]


def test_modes_beside_responses_have_a_posture_of_their_own(armonic: Armonic) -> None:
    true = am.load(TRUE)
    measure(true, "m.csv")
    write_modes("near.csv", true, [0.5, 1.0, -1.0], "damped_freq_hz,damping_ratio")
    write_modes("far.csv", true, [0.2, 0.6, -0.8], "natural_freq_hz")
    words = ("update", off(true, PATTERN), "m.csv", "--modes", "near.csv", "--modes", "far.csv", "-o", "new.yaml")
    places = ("--posture", "milling", "--posture", "0.5,1,-1", "--posture", "0.2,0.6,-0.8")
    data = armonic(*words, *places, "--parameters", PATTERN, "--json").json
    assert [entry["posture"] for entry in data["postures"]] == ["milling", "0.5,1,-1", "0.2,0.6,-0.8"]
    assert fitted() == pytest.approx(true.parameters(PATTERN), rel=EXACT)
    assert [label for label, _ in data["record"]["measurements"]] == ["m.csv", "near.csv", "far.csv"]
    assert "or one for each of the 3 files" in armonic(*words, *places[:4], "--force").error


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("freq_hz\n10\n", "natural_freq_hz is |λ|/2π, damped_freq_hz is Im λ/2π"),
        ("natural_freq_hz,damped_freq_hz\n10,10\n", "found natural_freq_hz and damped_freq_hz, expected one of them"),
        ("natural_freq_hz,zeta\n10,0.1\n", "Columns are natural_freq_hz,"),
        ("natural_freq_hz,damping_ratio\n10,1.1\n", "Percent are hundredths of it."),
        ("natural_freq_hz,damping_percent\n10,0\n", "damping_ratio: found 0"),
        ("natural_freq_hz\n-10\n", "positive frequencies"),
        ("natural_freq_hz\nten\n", "line 2: found 'ten' for natural_freq_hz"),
        ("natural_freq_hz\n10,3\n", "found 2 values"),
        ("natural_freq_hz,damping_deviation\n10,0.1\n", "a header such as"),
        ("damping_ratio\n0.1\n", "a header such as"),
        ("natural_freq_hz\n", "a header and no mode"),
        ("natural_freq_hz\n" + "10\n" * 19, "expected at most the model's 9"),
        ("natural_freq_hz\n10\n", "found 1 numbers for 18 parameters"),
        ("", "an empty file"),
    ],
)
def test_a_bad_table_of_modes_gets_one_line(armonic: Armonic, tmp_path: Path, text: str, said: str) -> None:
    Path("modes.csv").write_text(text, "utf-8")
    assert said in armonic("update", TRUE, "--modes", "modes.csv", "-o", "new.yaml").error
    assert files(tmp_path) == ["modes.csv"]


@pytest.mark.parametrize(
    "words",
    [
        ("--band", "5:10"),
        ("--frame", "sensor"),
        ("--kind", "mobility"),
        ("--reference-node", "1"),
        ("--responses", "x/x"),
    ],
)
def test_options_of_responses_need_responses(armonic: Armonic, words: tuple[str, ...]) -> None:
    write_modes("modes.csv", am.load(TRUE), "milling", "natural_freq_hz")
    error = armonic("update", TRUE, "--modes", "modes.csv", "-o", "new.yaml", *words).error
    assert f"{words[0]}: found it without FRF files" in error
