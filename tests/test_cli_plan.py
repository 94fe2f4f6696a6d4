"""`armonic plan`: what it chooses, prints and writes, from the robot alone or after measured files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.updating.planning import plan_measurement
from command_line import MEASURED, TRUE, WIDTH, Armonic, files

SAMPLE = (
    "--sample", "carousel.z=-30deg:30deg", "--sample", "link_arm.z=40deg:100deg", "--sample", "arm.z=-130deg:-70deg",
    "--samples", "32",
)  # fmt: skip
POSTURES = ("--candidates", "0,70deg,-100deg", "--candidates", "milling", "--candidates", "20deg,50deg,-80deg")


pytestmark = pytest.mark.usefixtures("empty_folder")


def test_plan_after_a_measured_file_prints_intervals_before_and_after_in_80_columns(armonic: Armonic) -> None:
    run = armonic("plan", TRUE, MEASURED, "--posture", "milling", *SAMPLE)
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    assert "32 candidates, after 1 measurement" in run.words
    rows = [line.split() for line in run.out.splitlines() if line.strip()]
    assert [row[0] for row in rows if row[0] in ("1.", "2.")] == ["1.", "2."]
    names = [row[0] for row in rows]
    table = rows[names.index("stiffness") : names.index("damping") + 10]
    assert [row[0] for row in table[1:10]] == [row[0] for row in table[11:]]  # nine axes, each twice
    by_name = {row[0]: row for row in table[11:]}
    assert by_name["arm.x"][-3:] == ["weak", "→", "identified"]
    assert by_name["link_arm.x"][-2:] == ["not", "identifiable"]
    open_ones = run.words.partition("newly identified.")[2].partition("So that what")[0]
    for name in ("carousel.z", "link_arm.x", "arm.y"):
        assert f"{name} (×/÷ " in open_ones
    assert "would determine them." in open_ones


def test_plan_of_a_robot_alone_assumes_the_noise_and_says_so(armonic: Armonic) -> None:
    run = armonic("plan", "kuka_kr90", *POSTURES, "--count", "1")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    assert "nothing measured yet" in run.words
    assert "Nothing has been measured yet." in run.words
    assert "The noise is assumed: 1 % of every value" in run.words
    named = armonic(
        "plan",
        "scompi",
        "--sensor",
        "tool",
        "--parameters",
        "links.*.drive.shaft_stiffness",
        "--candidates",
        "c1,c8,c50",
    )
    assert named.code == 0, named
    assert max(map(len, named.out.splitlines())) <= WIDTH


def test_json_and_csv_hold_what_the_library_plans(armonic: Armonic, tmp_path: Path) -> None:
    words = ("plan", TRUE, MEASURED, *SAMPLE, "--count", "2", "--noise", "2%", "--freq", "1:30:0.5")
    data = armonic(*words, "--json", "-o", "plan.csv").json
    robot = am.load(TRUE)
    ranges = {"carousel.z": (-30, 30), "link_arm.z": (40, 100), "arm.z": (-130, -70)}
    sample = am.Sample({name: tuple(np.deg2rad(ends)) for name, ends in ranges.items()}, 32)
    measured = am.Measurement(am.read_frf(MEASURED), "milling", weights="uniform")
    plan = plan_measurement(robot, measured, sample, noise=0.02, freq_hz=np.arange(2, 61) / 2)
    assert [c["candidate"] for c in data["chosen"]] == [c.label for c in plan.chosen]
    np.testing.assert_allclose(data["log_widths"], plan.log_widths, rtol=1e-9)
    assert data["parameters"][1]["verdicts"] == list(plan.parameters[1].verdicts)
    assert data["parameters"][0]["intervals"][0] == pytest.approx(plan.parameters[0].intervals[0])
    assert data["notes"] == list(plan.notes)
    assert data["written"] == {"ranking": "plan.csv"}
    assert files(tmp_path) == ["plan.csv"]
    with (tmp_path / "plan.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["rank"] for row in rows] == [str(i) for i in range(1, 33)]
    assert sorted(row["measure"] for row in rows if row["measure"]) == ["1", "2"]
    (first,) = [row for row in rows if row["measure"] == "1"]
    q = [float(first[name]) for name in robot.coordinates]
    np.testing.assert_array_equal(q, robot.posture(plan.chosen[0].posture))
    assert (first["sensor"], first["impact"], first["outputs"]) == ("sensor", "sensor", "x y z")
    assert armonic(*words, "-o", "plan.csv").error.endswith("Use --force to overwrite it.")
    assert "Wrote the ranking: plan.csv" in armonic(*words, "-o", "plan.csv", "--force").out


def test_a_robot_updated_before_is_planned_for_with_the_file_that_it_was_fitted_to(
    armonic: Armonic, tmp_path: Path
) -> None:
    start = str(Path(TRUE).with_name("kuka_start.yaml"))
    assert armonic("update", start, MEASURED, "-o", "updated.yaml").code == 0
    data = armonic("plan", "updated.yaml", MEASURED, *SAMPLE, "--json").json
    fit = am.update(am.load(start), am.Measurement(am.read_frf(MEASURED), "milling"))
    assert data["noise"] == pytest.approx(fit.noise, rel=1e-3)
    before = {p["path"]: p["verdicts"][0] for p in data["parameters"]}
    # Equal weights use the data better than stress on the peaks does, never worse.
    assert {before[p.path] for p in fit.parameters if p.verdict == "identified"} == {"identified"}
    assert sum(verdict == "identified" for verdict in before.values()) < len(before)


def test_impact_points_and_directions_are_ranked_one_by_one(armonic: Armonic) -> None:
    words = ("plan", "kuka_kr90", "--candidates", "milling", "--impact", "sensor", "--impact", "arm", "--each-input")
    data = armonic(*words, "--outputs", "xz", "--json").json
    assert len(data["ranking"]) == 6
    assert {(c["impact"], *c["inputs"]) for c in data["ranking"]} == {(f, a) for f in ("sensor", "arm") for a in "xyz"}
    assert all(c["outputs"] == ["x", "z"] for c in data["ranking"])
    assert all("milling, force at " in c["candidate"] for c in data["ranking"])


def test_grid_base_criterion_bounds_and_priors_are_taken(armonic: Armonic) -> None:
    grid = ("--grid", "link_arm.z=50deg:90deg:3", "--grid", "arm.z=-1.7,-1.2", "--base", "milling")
    data = armonic("plan", "kuka_kr90", *grid, "--criterion", "A", "--count", "3", "--json").json
    assert (len(data["ranking"]), len(data["chosen"]), data["criterion"]) == (6, 3, "A")
    path = "links.arm.elasticity.y.damping"
    words = ("plan", "kuka_kr90", *grid, "--parameters", "damping", "--bounds", f"{path}=70:90", "--json")
    bare, sure = armonic(*words).json, armonic(*words, "--prior", f"{path}=3%").json
    verdicts = [next(p["verdicts"][0] for p in data["parameters"] if p["path"] == path) for data in (bare, sure)]
    assert verdicts == ["not identifiable", "identified"]
    table = armonic("plan", "kuka_kr90", *grid, "--count", "5").out
    assert "after 1" in table
    assert "after 5" in table
    assert "after 3" not in table


def test_a_path_and_all_named_postures_are_candidates(armonic: Armonic) -> None:
    words = ("plan", "scompi", "--sensor", "tool", "--parameters", "links.*.drive.shaft_stiffness", "--freq", "1:30:1")
    assert len(armonic(*words, "--candidates", "table", "--json").json["ranking"]) == 50
    assert len(armonic(*words, "--json").json["ranking"]) == len(am.load("scompi").postures)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "found no candidates, expected one of --candidates, --grid and --sample"),
        ((*POSTURES, *SAMPLE), "found --candidates and --sample"),
        (("--candidates", "home"), "'home'"),
        (("--candidates", "milling,home"), "'home'"),
        (("--candidates", "milling,"), "''"),
        (("--candidates", "1,2"), "2 values"),
        (("--grid", "arm.z=0:1"), "lo:hi:n"),
        (("--grid", "leg.z=0:1:3"), "leg.z"),
        (("--sample", "arm.z=1:0"), "lo <= hi"),
        (("--sample", "arm.z=0:1", "--samples", "0"), "1 to"),
        ((*POSTURES, "--base", "milling"), "without --grid or --sample"),
        ((*POSTURES, "--posture", "milling"), "Postures to choose from are --candidates"),
        ((*POSTURES, "--frame", "sensor"), "where the sensor may sit is --sensor"),
        ((*POSTURES, "--sensor", "nose"), "'nose'"),
        ((*POSTURES, "--impact", "nose"), "'nose'"),
        ((*POSTURES, "--count", "0"), "count"),
        ((*POSTURES, "--count", "4"), "4 of 3 candidates"),
        ((*POSTURES, "--criterion", "E"), "one of intervals, D, A"),
        ((*POSTURES, "--noise", "-1"), "a positive share"),
        ((*POSTURES, "--noise", "much"), "a positive share"),
        ((*POSTURES, "--freq", "1:2"), "start:stop:step"),
        ((*POSTURES, "--parameters", "links.leg.*"), "links.leg"),
        ((*POSTURES, "--prior", "0.1"), "PATTERN=SHARE"),
        ((*POSTURES, "--prior", "*.damping=0"), "a positive share"),
        ((*POSTURES, "--bounds", "*.damping=1"), "--bounds"),
        ((*POSTURES, "-o", "no/where.csv"), "no folder"),
        ((*POSTURES, "--outputs", "q"), "--outputs"),
    ],
)
def test_bad_words_get_one_line_and_exit_code_2(armonic: Armonic, words: tuple[str, ...], said: str) -> None:
    assert said in armonic("plan", "kuka_kr90", *words).error


def test_bad_files_get_one_line_and_nothing_is_written(armonic: Armonic, tmp_path: Path) -> None:
    assert "nobody.uff" in armonic("plan", TRUE, "nobody.uff", *SAMPLE, "-o", "plan.csv").error
    assert "--posture" in armonic("plan", TRUE, MEASURED, *SAMPLE, "--posture", "a", "--posture", "b").error
    assert files(tmp_path) == []


def test_help_of_plan_fits_80_columns_and_the_command_is_listed(armonic: Armonic) -> None:
    run = armonic("plan", "--help")
    assert (run.code, run.err) == (0, "")
    assert run.out.startswith("Usage: armonic plan")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    listed = armonic("--help").out
    assert "plan" in listed.partition("Commands:")[2]
    assert "..." not in listed.partition("Commands:")[2]
