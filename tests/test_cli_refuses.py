"""Bad input on the command line: exit code 2, one line on stderr that says why, and no file written."""

from __future__ import annotations

from pathlib import Path

import pytest

import armonic as am
from command_line import MEASURED, START, TRUE, Armonic, Run, files

UPDATE = ("update", TRUE, MEASURED, "-o", "new.yaml")


pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fly",), "No such command 'fly'"),
        (("--fast",), "No such option: --fast"),
        (("modes",), "Missing argument 'ROBOT'"),
        (("modes", "kuka_kr90", "--postures", "milling"), "--posture"),
        (("modes", "kuka_kr90", "--posture"), "requires an argument"),
        (("modes", "kuka_kr9"), "Did you mean kuka_kr90?"),
        (("modes", "nowhere/robot.yaml"), "found no file there"),
        (("modes", "."), "found a directory"),
        (("modes", "kuka_kr90", "--posture", "home"), "There is milling."),
        (("modes", "kuka_kr90", "--posture", "0,1"), "found 2 values"),
        (("modes", "kuka_kr90", "--posture", "0,70 furlong,1"), "furlong"),
        (("modes", "kuka_kr90", "--posture", "nan,0,0"), "found nan"),
        (("modes", "kuka_kr90", "--posture", "0,1e999,0"), "found inf"),
        (("modes", "kuka_kr90", "--posture", ""), "posture"),
        (("modes", "kuka_kr90", "--wrench", "1,2,3"), "fx,fy,fz,mx,my,mz"),
        (("modes", "kuka_kr90", "--wrench", "0,0,inf,0,0,0"), "fx,fy,fz,mx,my,mz"),
        (("modes", "kuka_kr90", "--wrench", "0,0,1,0,0,0", "--frame", "tip"), "found 'tip'"),
        (("modes", "kuka_kr90", "--frame", "sensor"), "without a wrench"),
        (("modes", "kuka_kr90", "--equilibrium", "moving"), "one of reference, static"),
    ],
)
def test_modes_refuses(armonic: Armonic, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    run = armonic(*words)
    assert said in run.error
    assert run.out == ""
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--freq", "1:2"), "start:stop:step"),
        (("--freq", "1:2:x"), "start:stop:step"),
        (("--freq", "2:1:0.1"), "start:stop:step"),
        (("--freq", "1:2:0"), "start:stop:step"),
        (("--freq", "1:2:-1"), "start:stop:step"),
        (("--freq", "-1:2:1"), "start:stop:step"),
        (("--freq", "nan:2:1"), "start:stop:step"),
        (("--freq", "0:inf:1"), "start:stop:step"),
        (("--freq", "1:1e999999:1"), "--freq"),
        (("--freq", "1:2:1e-9"), "at most 1000000"),
        (("--kind", "stiffness"), "one of receptance, mobility, accelerance"),
        (("--outputs", "xw"), "x y z rx ry rz"),
        (("--inputs", "xx"), "x y z rx ry rz"),
        (("--inputs", ""), "x y z rx ry rz"),
        (("--frame", "tip"), "found 'tip'"),
        (("-o", "f.mat"), "found the ending '.mat'"),
        (("-o", "nowhere/f.uff"), "no folder"),
        (("-o", "."), "a folder"),
        (("-o", "f.csv", "--binary"), "--binary"),
        (("--binary",), "--binary"),
    ],
)
def test_frf_refuses(armonic: Armonic, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    run = armonic("frf", "kuka_kr90", *words)
    assert said in run.error
    assert run.out == ""
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("update", TRUE, "-o", "new.yaml"), "found no measured file, expected FRF_FILE..., --modes FILE"),
        (("update", TRUE, "nothing.uff", "-o", "new.yaml"), "nothing.uff: found No such file"),
        (("update", TRUE, TRUE, "-o", "new.yaml"), "found the ending '.yaml'"),
        (("update", TRUE, MEASURED, "-o", "nowhere/new.yaml"), "no folder"),
        (("update", TRUE, MEASURED, "-o", MEASURED, "--force"), "already uses"),
        ((*UPDATE, "--report", "new.yaml"), "already uses"),
        ((*UPDATE, "--report", "nowhere/r.html"), "no folder"),
        ((*UPDATE, "--posture", "home"), "There is milling."),
        ((*UPDATE, "--posture", "milling", "--posture", "milling"), "found 2 of them"),
        ((*UPDATE, "--frame", "tip"), "found 'tip'"),
        ((*UPDATE, "--parameters", "links.arm.stiffness"), "links.arm.stiffness"),
        ((*UPDATE, "--bounds", "stiffness"), "PATTERN=lo:hi"),
        ((*UPDATE, "--bounds", "=1:2"), "PATTERN=lo:hi"),
        ((*UPDATE, "--bounds", "stiffness=1"), "PATTERN=lo:hi"),
        ((*UPDATE, "--bounds", "stiffness=1:nan"), "PATTERN=lo:hi"),
        ((*UPDATE, "--bounds", "nothing=1:2"), "nothing"),
        ((*UPDATE, "--bounds", "stiffness=2:1"), "low < high"),
        ((*UPDATE, "--bounds", "damping=-1:1e9"), "positive"),
        ((*UPDATE, "--bounds", "links.arm.elasticity.z.stiffness=1:2"), "exclude the start"),
        ((*UPDATE, "--weights", "heavy"), "one of peaks, uniform"),
        ((*UPDATE, "--band", "5"), "lo:hi"),
        ((*UPDATE, "--band", "9:5"), "lo:hi"),
        ((*UPDATE, "--band", "50:60"), "no line from 50 to 60 Hz"),
        ((*UPDATE, "--symmetrize", "both"), "one of average, upper, lower"),
        ((*UPDATE, "--inputs", "x", "--symmetrize", "average"), "expected the outputs"),
        ((*UPDATE, "--max-evaluations", "0"), "at least 1"),
        ((*UPDATE, "--max-evaluations", "many"), "--max-evaluations"),
        ((*UPDATE, "--kind", "stiffness"), "one of receptance"),
        ((*UPDATE, "--scale", "-1"), "a positive number"),
        ((*UPDATE, "--axes", "x"), "pairs such as"),
        ((*UPDATE, "--axes", "x:y"), "two axes that fall on one"),
        ((*UPDATE, "--outputs", "rx"), "no response"),
        ((*UPDATE, "--response-node", "7"), "node 7"),
        ((*UPDATE, "--responses", "xx"), "pairs output/input"),
        ((*UPDATE, "--responses", "x/x,x/x"), "pairs output/input"),
        ((*UPDATE, "--responses", "x/x/x"), "pairs output/input"),
        ((*UPDATE, "--responses", "x/q"), "pairs output/input"),
        ((*UPDATE, "--responses", ""), "pairs output/input"),
        ((*UPDATE, "--responses", "rx/x"), "no response rx/x"),
        ((*UPDATE, "--responses", "x/x", "--outputs", "x"), "--outputs as well"),
        ((*UPDATE, "--responses", "x/x", "--inputs", "x"), "--inputs as well"),
        ((*UPDATE, "--responses", "x/x", "--symmetrize", "average"), "--symmetrize as well"),
        ((*UPDATE, "--parameters", "arm.z"), "Did you mean links.arm.elasticity.z.*?"),
        ((*UPDATE, "--parameters", "arm.z.damping"), "Did you mean links.arm.elasticity.z.damping?"),
        ((*UPDATE, "--parameters", "z"), "Did you mean links.*.elasticity.z.*?"),
        ((*UPDATE, "--parameters", "arn.z"), "The first of 18"),
        (("check", "nothing.yaml"), "found no file there"),
        (("check", MEASURED), "kuka_milling.uff"),
        (("demo", "--into", MEASURED), "found a file"),
        (("demo", "--into", f"{MEASURED}/demo"), "Not a directory"),
    ],
)
def test_update_check_and_demo_refuse(armonic: Armonic, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    run = armonic(*words)
    assert said in run.error
    assert run.out == ""
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "an empty file"),
        (Path(MEASURED).read_text("utf-8")[:30_000], "truncated"),
        (Path(MEASURED).read_text("utf-8").replace("-7.491531000000e-07", "NaN                "), "NaN"),
        (Path(MEASURED).read_text("utf-8").replace("-7.491531000000e-07", " 0.00000000000e+00").replace(
            "3.013709000000e-10", "0.000000000000e+00"), "exactly zero"),
        (Path(MEASURED).read_text("utf-8").replace("sensor frame: sensor", "sensor frame: tip"), "--frame"),
    ],
    ids=["empty", "truncated", "NaN", "zero", "frame"],
)  # fmt: skip
def test_a_damaged_measurement_is_refused_and_named(armonic: Armonic, tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "bad.uff").write_text(content, "utf-8")
    error = armonic("update", TRUE, "bad.uff", "-o", "new.yaml", "--report", "r.html").error
    assert "bad.uff" in error
    assert said in error
    assert files(tmp_path) == ["bad.uff"]


def test_existing_outputs_stay_as_they_are_without_force(armonic: Armonic, tmp_path: Path) -> None:
    for name in ("new.yaml", "r.html", "f.uff"):
        (tmp_path / name).write_text("mine", "utf-8")
    for words in (
        ("update", TRUE, MEASURED, "-o", "new.yaml"),
        ("update", TRUE, MEASURED, "-o", "other.yaml", "--report", "r.html"),
        ("frf", TRUE, "-o", "f.uff"),
    ):
        assert "--force" in armonic(*words).error
    assert {(tmp_path / name).read_text("utf-8") for name in files(tmp_path)} == {"mine"}
    assert armonic("frf", TRUE, "-o", "f.uff", "--force").code == 0
    assert "mine" not in (tmp_path / "f.uff").read_text("utf-8")
    assert files(tmp_path) == ["f.uff", "new.yaml", "r.html"]


def test_a_posture_and_a_frame_must_be_chosen_where_there_are_several(armonic: Armonic, tmp_path: Path) -> None:
    text = Path(START).read_text("utf-8")
    (tmp_path / "two.yaml").write_text(
        text.replace("postures:", "  - {name: tip, link: arm}\npostures:\n  home: [0, 0, 0]"), "utf-8"
    )
    (tmp_path / "none.yaml").write_text(text[: text.index("frames:")], "utf-8")
    assert "--posture: found no posture, expected one of home, milling." in armonic("modes", "two.yaml").error
    assert (
        "--frame: found no frame, expected one of sensor, tip." in armonic("frf", "two.yaml", "--posture", "home").error
    )
    assert "carousel.z, link_arm.z, arm.z" in armonic("modes", "none.yaml").error
    assert "one of base, carousel" in armonic("frf", "none.yaml", "--posture", "0,0,0").error


def test_options_that_only_universal_files_have_are_refused_with_csv(armonic: Armonic, tmp_path: Path) -> None:
    assert armonic("frf", TRUE, "-o", "m.csv").code == 0
    assert "--scale" in armonic("update", TRUE, "m.csv", "-o", "new.yaml", "--scale", "2").error
    assert files(tmp_path) == ["m.csv"]


@pytest.mark.parametrize(
    ("words", "where", "hint"),
    [
        (("modes", "nobody"), "nobody", None),
        (("modes", "kuka_kr9"), "kuka_kr9", "Did you mean kuka_kr90?"),
        (("frf", "huynh_3r", "--freq", "x"), "--freq", None),
        (("demo", "--into", f"{MEASURED}/demo"), f"{MEASURED}/demo", None),
        (("modes",), "armonic modes", "See `armonic modes --help`."),
    ],
)
def test_with_json_an_error_is_an_object_too(
    armonic: Armonic, words: tuple[str, ...], where: str, hint: str | None
) -> None:
    run = armonic(*words, "--json")
    error = Run(0, run.out, "").json["error"]
    assert set(error) == {"where", "found", "expected", "hint", "message"}
    assert run.error == f"error: {error['message']}"
    assert (error["where"], error["hint"]) == (where, hint)
    assert error["found"] in error["message"]


def test_check_with_json_finds_what_makes_a_file_invalid(armonic: Armonic, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("armonic: 1\nname: bad\nlinks: []\n", "utf-8")
    run = armonic("check", "bad.yaml", "--json")
    assert run.error
    data = Run(0, run.out, "").json
    assert data["ok"] is False
    assert data["findings"][0]["where"] == "line 3, links"


@pytest.mark.parametrize(
    ("hint", "typed"),
    [
        ("Pick one with response_node=.", "Pick one with --response-node."),
        ("If you know what was measured, say so with kind=.", "If you know what was measured, say so with --kind."),
        ("Take the axes that both share, with frf.select(outputs=..., inputs=...).",
         "Take the axes that both share, with --outputs and --inputs."),
        ("Give it a small positive start, or leave it out of `parameters`.",
         "Give it a small positive start, or leave it out of --parameters."),
    ],
)  # fmt: skip
def test_hints_for_programs_become_options(armonic: Armonic, monkeypatch, hint: str, typed: str) -> None:
    def refuse(_: str) -> None:
        raise am.DataFileError("f.uff", found="this", expected="that", hint=hint)

    monkeypatch.setattr("armonic.cli.arguments.open_robot", refuse)
    assert armonic("modes", "robot.yaml").error == f"error: f.uff: found this, expected that. {typed}"


def test_a_response_that_the_model_cannot_have_is_to_be_left_out_by_option(armonic: Armonic, tmp_path: Path) -> None:
    spring = "elasticity: {z: {stiffness: 1e5, damping: 30}}"
    (tmp_path / "flat.yaml").write_text(
        "armonic: 1\nname: flat\nframes: [{name: tip, link: a, placement: [{x: 1}]}]\npostures: {p: [0.3]}\n"
        f"links: [{{name: a, parent: base, joint: {{type: revolute, axis: z}}, {spring}, mass: 1, com: [1, 0, 0]}}]\n",
        "utf-8",
    )
    lines = "\n".join(f"{hz},1,0.1,1,0.2,1,0.3,1,0.4" for hz in range(1, 9))
    header = ",".join(f"{a}/{b} {part}" for a in "yz" for b in "yz" for part in ("re", "im"))
    (tmp_path / "m.csv").write_text(f"# armonic frf kind=mobility\nfreq_hz,{header}\n{lines}\n", "utf-8")
    words = ("update", "flat.yaml", "m.csv", "-o", "new.yaml")
    error = armonic(*words).error
    assert "zero in the model" in error
    assert "--responses" in error
    assert "frf.select" not in error
    assert armonic(*words, "--responses", "y/y", "--bounds", "*=1e-9:1e15").code == 0


def test_a_robot_without_elasticity_is_refused(armonic: Armonic, tmp_path: Path) -> None:
    link = "{name: a, parent: base, joint: {type: revolute, axis: z}, mass: 1}"
    text = f"armonic: 1\nname: rigid\nlinks:\n  - {link}\n"
    (tmp_path / "rigid.yaml").write_text(text, "utf-8")
    assert "elasticity" in armonic("modes", "rigid.yaml", "--posture", "0").error
