"""What `armonic update` can be asked for: methods, costs, what is held, tied, known or ruled by a law, checkpoints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.cli import fitting
from command_line import MEASURED, START, TRUE, WIDTH, Armonic, Run, files
from update_files import DAMPING, EXACT, PATTERN, STIFFNESS, fitted, measure, off

TWINS = ("links.arm.elasticity.x.stiffness", "links.arm.elasticity.y.stiffness")
UPDATE = ("update", TRUE, MEASURED, "-o", "new.yaml")


pytestmark = pytest.mark.usefixtures("empty_folder")


# Methods, costs, losses


@pytest.mark.parametrize(
    ("method", "stages"),
    [
        ((), ["σ = ", "levelled", "cost"]),
        (("--method", "continuation"), ["σ = ", "levelled", "cost"]),
        (("--method", "least-squares"), ["cost"]),
        (("--method", "genetic", "--population", "12", "--generations", "4"), ["genetic"]),
    ],
)
def test_every_method_finds_the_true_values_and_says_by_which_stages(
    armonic: Armonic, method: tuple[str, ...], stages: list[str]
) -> None:
    true = am.load(TRUE)
    measure(true, "m.csv")
    data = armonic(
        "update", off(true, PATTERN), "m.csv", "-o", "new.yaml", "--parameters", PATTERN, "--json", *method
    ).json
    assert fitted() == pytest.approx(true.parameters(PATTERN), rel=1e-3 if "genetic" in method else EXACT)
    names = [stage["name"] for stage in data["stages"]]
    assert all(any(name.startswith(begin) for name in names) for begin in stages)
    assert data["method"] == (method[1] if method else "continuation").replace("-", "_")
    assert sum(stage["evaluations"] for stage in data["stages"]) <= data["evaluations"]
    assert data["record"]["method"] == data["method"]
    assert data["record"]["armonic"] == am.__version__
    assert data["record"]["parameters"] == [STIFFNESS, DAMPING]
    if "genetic" in method:
        options = data["record"]["options"]["genetic"]
        assert (options["population"], options["generations"]) == (12, 4)


def test_the_cost_is_a_sum_of_squared_logarithms_or_of_shares(armonic: Armonic) -> None:
    measured, model = (
        am.read_frf(MEASURED),
        am.frf(am.load(TRUE), "milling", am.read_frf(MEASURED).freq_hz, frame="sensor"),
    )
    ratio = model.values / measured.values
    words = (*UPDATE, "--parameters", PATTERN, "--weights", "uniform", "--json", "--force", "--max-evaluations", "1")
    for cost, expected in (
        ("logarithmic", np.sum(np.log(np.abs(ratio)) ** 2 + np.angle(ratio) ** 2)),
        ("relative", np.sum(np.abs(ratio - 1) ** 2)),
    ):
        assert armonic(*words, "--cost", cost).json["start_cost"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_a_robust_loss_shrugs_off_what_squares_follow(armonic: Armonic, loss: str) -> None:
    measured = am.read_frf(MEASURED)
    values = measured.values.copy()
    values[90:110] *= 8  # lines of a cable that moved
    am.write_frf("m.csv", replace(measured, values=values))
    true = am.load(TRUE).parameters(PATTERN)
    words = ("update", TRUE, "m.csv", "-o", "new.yaml", "--force", "--parameters", PATTERN, "--weights", "uniform")
    errors = []
    for given in ("squares", loss):
        assert armonic(*words, "--loss", given).code == 0
        errors.append(max(abs(np.log(fitted()[path] / value)) for path, value in true.items()))
    assert errors[1] < errors[0] / 50


def test_a_wider_tolerance_takes_fewer_evaluations(armonic: Armonic) -> None:
    words = ("update", START, MEASURED, "-o", "new.yaml", "--force", "--json", "--method", "least-squares")
    coarse, fine = (armonic(*words, "--tolerance", tolerance).json for tolerance in ("1e-2", "1e-12"))
    assert coarse["evaluations"] < fine["evaluations"]
    assert fine["cost"] <= coarse["cost"]


def test_starts_are_drawn_from_the_seed_whatever_the_number_of_threads(armonic: Armonic) -> None:
    words = ("update", START, MEASURED, "-o", "new.yaml", "--force", "--json", "--starts", "3", "--band", "5:25")
    one, two, other = (
        armonic(*words, *more).json
        for more in (("--threads", "1"), ("--threads", "2"), ("--threads", "1", "--seed", "7"))
    )
    assert len(one["starts"]) == 3
    assert one["starts"] == two["starts"]
    assert [p["value"] for p in one["parameters"]] == [p["value"] for p in two["parameters"]]
    assert one["starts"][0] == other["starts"][0]
    assert one["starts"][1:] != other["starts"][1:]
    assert (one["record"]["seed"], other["record"]["seed"]) == (0, 7)
    assert one["cost"] == min(one["starts"])


# What is held, tied, known, and ruled by a law


def test_what_is_held_stays_or_takes_the_value_that_was_typed(armonic: Armonic) -> None:
    words = (*UPDATE, "--parameters", PATTERN, "--hold", DAMPING, "--hold", "links.arm.mass=0.22 t")
    data = armonic(*words, "--hold", "links.*.com.y = 0.01", "--json").json
    assert [p["path"] for p in data["parameters"]] == [STIFFNESS]
    new, true = am.load("new.yaml"), am.load(TRUE)
    assert fitted()[DAMPING] == true.parameters(DAMPING)[DAMPING]
    assert new.numbers("links.arm.mass")["links.arm.mass"] == 220
    assert set(new.numbers("links.*.com.y").values()) == {0.01}


def test_what_is_tied_takes_one_value(armonic: Armonic) -> None:
    twin = am.load(TRUE).with_values(dict.fromkeys(TWINS, 7e6))
    measure(twin, "m.csv", freq_hz=np.arange(1, 101) * 1.5)
    start = off(twin.with_values({TWINS[1]: 6.5e6}), TWINS[0])
    data = armonic(
        "update", start, "m.csv", "-o", "new.yaml", "--parameters", ",".join(TWINS), "--tie", ",".join(TWINS), "--json"
    ).json
    (parameter,) = data["parameters"]
    assert parameter["tied"] == list(TWINS)
    assert parameter["value"] == pytest.approx(7e6, rel=EXACT)
    assert set(fitted(pattern=",".join(TWINS)).values()) == {parameter["value"]}
    both = armonic(
        "update", start, "m.csv", "-o", "new.yaml", "--force", "--parameters", ",".join(TWINS), "--tie",
        "links.arm.elasticity.[xy].stiffness",
    )  # fmt: skip
    assert both.code == 0
    assert set(fitted(pattern=",".join(TWINS)).values()) == {parameter["value"]}


def test_a_prior_decides_where_the_data_do_not(armonic: Armonic) -> None:
    path = "links.arm.elasticity.y.damping"  # which the example leaves open
    words = (*UPDATE, "--parameters", path, "--force", "--json")
    (free,) = armonic(*words).json["parameters"]
    assert free["verdict"] == "weak"
    (sure,) = armonic(*words, "--prior", f"{path}=1%@90").json["parameters"]
    # Three of the prior's own standard deviations.
    assert sure["value"] == pytest.approx(90, rel=0.03)
    assert sure["verdict"] == "identified"
    (same,) = armonic(*words, "--prior", f"{path} = 0.01 @ 90").json["parameters"]
    assert same["value"] == sure["value"]
    (own,) = armonic(*words, "--prior", "links.arm.elasticity.y.*=1%", "--parameters", "links.arm.elasticity.y.*").json[
        "parameters"
    ][1:]
    assert own["value"] == pytest.approx(80, rel=0.03)  # that of the robot file


def test_the_deviation_of_a_number_that_may_be_negative_is_in_its_unit(armonic: Armonic) -> None:
    path = "links.arm.com.z"
    words = (*UPDATE, "--parameters", path, "--force", "--hold", "elasticity")
    (p,) = armonic(*words, "--prior", f"{path}=1e-6@-0.021", "--json", "--bounds", f"{path}=-0.1:0.1").json[
        "parameters"
    ]
    assert p["scale"] == "linear"
    assert p["value"] == pytest.approx(-0.021, abs=3e-6)
    run = armonic(*words, "--prior", f"{path}=0.01")
    assert "-0.02" in run.out.partition("com.z")[2].partition("…")[0]  # the lower end of the interval is no open one
    assert "found percent of links.arm.com.x, which" in armonic(*words, "--prior", "links.arm.com.*=10%").error


@pytest.mark.parametrize(("over", "slope"), [("link_arm.z", -4e5), ("torque", 1200.0)])
def test_a_law_finds_how_a_stiffness_changes_from_posture_to_posture(armonic: Armonic, over: str, slope: float) -> None:
    true, value = am.load(TRUE), 2.2e6
    for name, where in (("a.csv", [0.0, 1.2, -1.7]), ("b.csv", [0.5, 0.6, 0.4])):
        q = true.posture(where)
        torque = abs(true.mechanism.gravity_torque(q)[true.coordinates.index("arm.z")])
        here = value + slope * (torque if over == "torque" else q[true.coordinates.index(over)])
        measure(true.with_values({STIFFNESS: here}), name, where)
    words = ("update", TRUE, "a.csv", "b.csv", "--posture", "0,1.2,-1.7", "--posture", "0.5,0.6,0.4", "-o", "new.yaml")
    data = armonic(*words, "--parameters", PATTERN, "--law", f"{STIFFNESS}={over}", "--json").json
    found = {p["path"]: p["value"] for p in data["parameters"]}
    assert found[STIFFNESS] == pytest.approx(value, rel=1e-5)
    assert found[f"{STIFFNESS} per {over}"] == pytest.approx(slope, rel=1e-5)
    run = armonic(*words, "--parameters", PATTERN, "--law", f"{STIFFNESS}={over}", "--force")
    assert (run.code, run.err) == (0, "")
    assert "the robot file holds the value where the coordinate, or the load, is zero" in run.words
    assert fitted()[STIFFNESS] == found[STIFFNESS]
    assert max(map(len, run.out.splitlines())) <= WIDTH


# A run that is ended, and goes on


def interrupting(at: int) -> Callable[[], object]:
    """In place of the progress bar: Ctrl-C at some evaluation."""

    @contextmanager
    def bar() -> Iterator[Callable[[am.Progress], None]]:
        def interrupt(now: am.Progress) -> None:
            if now.evaluations >= at:
                raise KeyboardInterrupt

        yield interrupt

    return bar


@pytest.mark.parametrize(
    ("method", "at"),
    [((), 24), (("--method", "genetic", "--population", "10", "--generations", "3", "--max-evaluations", "400"), 25)],
)
def test_a_run_that_was_ended_goes_on_to_the_same_result(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: tuple[str, ...], at: int
) -> None:
    words = ("update", START, MEASURED, *method)
    whole = armonic(*words, "-o", "whole.yaml", "--json").json
    with monkeypatch.context() as patch:
        patch.setattr(fitting, "fit_progress", interrupting(at))
        run = armonic(*words, "-o", "new.yaml", "--checkpoint", "run.json")
    assert run.code == 130
    kept = "interrupted: the best of "
    assert run.err.startswith(kept)
    assert run.err.endswith(" was kept and written; the same command with --force goes on from run.json\n")
    assert files(tmp_path) == ["new.yaml", "run.json", "whole.yaml"]
    assert "Use --force" in armonic(*words, "-o", "new.yaml", "--checkpoint", "run.json").error
    data = armonic(*words, "-o", "new.yaml", "--checkpoint", "run.json", "--force", "--json").json
    assert [p["value"] for p in data["parameters"]] == [p["value"] for p in whole["parameters"]]
    assert (data["cost"], data["status"]) == (whole["cost"], whole["status"])
    assert fitted(pattern="elasticity") == fitted("whole.yaml", "elasticity")


def test_ctrl_c_before_anything_new_is_found_says_that_the_state_is_kept(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    words = (*UPDATE, "--parameters", PATTERN, "--checkpoint", "run.json")
    assert armonic(*words).code == 0
    (tmp_path / "new.yaml").unlink()
    monkeypatch.setattr("armonic.updating.update", interrupt)
    run = armonic(*words)
    assert run == Run(130, "", "interrupted: nothing was written, but the same command goes on from run.json\n")
    assert files(tmp_path) == ["run.json"]


def test_ctrl_c_while_measurements_are_read_says_that_nothing_was_written(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("armonic.cli.fitting.measurements", interrupt)
    assert armonic(*UPDATE) == Run(130, "", "interrupted: nothing was written\n")
    assert files(tmp_path) == []


def test_a_checkpoint_of_another_problem_is_refused_and_kept(armonic: Armonic, tmp_path: Path) -> None:
    words = (*UPDATE, "--parameters", PATTERN, "--checkpoint", "run.json", "--force")
    assert armonic(*words).code == 0
    before = (tmp_path / "run.json").read_bytes()
    for other in (("--seed", "3"), ("--weights", "uniform"), ("--hold", DAMPING), ("--cost", "relative")):
        assert "another problem" in armonic(*words, *other).error
    for name in ("run.json", "new.yaml"):
        again = ("update", TRUE, MEASURED, "-o", name, "--checkpoint", name, "--force")
        assert "already uses" in armonic(*again).error
    assert (tmp_path / "run.json").read_bytes() == before


# What is refused


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--method", "magic"), "--method: found 'magic', expected one of continuation, least-squares, genetic"),
        (("--cost", "high"), "one of logarithmic, relative"),
        (("--loss", "total"), "one of squares, huber, cauchy"),
        (("--starts", "0"), "--starts: found 0, expected a whole number of at least 1"),
        (("--starts", "many"), "--starts"),
        (("--starts", "2", "--method", "genetic"), "--starts: found 2 beside --method genetic"),
        (("--seed", "-1"), "--seed: found -1"),
        (("--threads", "0"), "--threads: found 0"),
        (("--tolerance", "0"), "--tolerance: found 0"),
        (("--tolerance", "2"), "--tolerance: found 2"),
        (("--tolerance", "nan"), "--tolerance: found nan"),
        (("--max-evaluations", "0"), "--max-evaluations: found 0"),
        (("--population", "20"), "--population: found it beside --method continuation, expected --method genetic"),
        (("--generations", "20"), "--generations: found it beside"),
        (("--population", "2", "--method", "genetic"), "--population: found 2"),
        (("--generations", "0", "--method", "genetic"), "--generations: found 0"),
        (("--hold", "nothing"), "--hold: found 'nothing'"),
        (("--hold", ""), "--hold: found ''"),
        (("--hold", "=3"), "--hold: found '=3'"),
        (("--hold", f"{DAMPING}="), "PATTERN=VALUE"),
        (("--hold", f"{DAMPING}=-3"), f"--hold {DAMPING}=-3: found"),
        (("--hold", f"{DAMPING}=3 pints"), "'pints' is not known"),
        (("--hold", f"{DAMPING}=nan"), "--hold"),
        (("--hold", "elasticity"), "--hold: found every parameter"),
        (("--tie", DAMPING), "found one number"),
        (("--tie", f"{DAMPING},"), "--tie: found"),
        (("--tie", "nothing,none"), "--tie: found 'nothing'"),
        (("--tie", PATTERN), "expected numbers of one kind"),
        (("--tie", ",".join(TWINS), "--tie", ",".join(TWINS)), "in two of them"),
        (("--tie", ",".join(TWINS), "--hold", TWINS[0]), "which is held"),
        (("--prior", DAMPING), "--prior: found"),
        (("--prior", f"{DAMPING}=likely"), "a positive share"),
        (("--prior", f"{DAMPING}=0"), "a positive share"),
        (("--prior", f"{DAMPING}=-10%"), "a positive share"),
        (("--prior", f"{DAMPING}=10%@much"), "PATTERN=SHARE@VALUE"),
        (("--prior", f"{DAMPING}=10%@-3"), "expected a positive value"),
        (("--prior", f"{DAMPING}=10%@inf"), "PATTERN=SHARE@VALUE"),
        (("--prior", f"{DAMPING}=10%", "--prior", f"{DAMPING}=20%"), "twice"),
        (("--prior", "nothing=10%"), "--prior: found 'nothing'"),
        (("--prior", "links.arm.mass=10%"), "not fitted"),
        (("--law", STIFFNESS), "PATTERN=COORDINATE"),
        (("--law", f"{STIFFNESS}="), "PATTERN=COORDINATE"),
        (("--law", f"{STIFFNESS}=arm"), "found 'arm', expected \"torque\" or one of carousel.z"),
        (("--law", "nothing=torque"), "--law: found 'nothing'"),
        (("--law", f"{STIFFNESS}=arm.z", "--hold", STIFFNESS), "not fitted"),
        (("--checkpoint", "no/run.json"), "no such folder"),
        (("--checkpoint", MEASURED), f"checkpoint {MEASURED}: found no JSON"),
        (("--modes", "nobody.csv"), "nobody.csv"),
        (("--modes", MEASURED), "kuka_milling.uff"),
        (("--coherence", MEASURED), "expected coherence: data sets 58 of function type 6"),
    ],
)
def test_bad_words_get_one_line_and_exit_code_2_and_nothing_is_written(
    armonic: Armonic, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    run = armonic(*UPDATE, *words)
    assert said in run.error
    assert files(tmp_path) == []


def test_without_any_measured_file_there_is_nothing_to_fit(armonic: Armonic, tmp_path: Path) -> None:
    run = armonic("update", TRUE, "-o", "new.yaml")
    assert "found no measured file, expected FRF_FILE..., --modes FILE, or both" in run.error
    assert files(tmp_path) == []


def test_without_an_output_the_fit_is_shown_and_not_kept(armonic: Armonic, empty_folder: Path) -> None:
    run = armonic("update", TRUE, MEASURED)
    assert run.code == 0
    assert "The fit converged" in run.out
    assert run.err == "nothing was written: -o FILE keeps the updated robot\n"
    assert files(empty_folder) == []


# Help


def test_help_of_update_stands_in_sections_of_80_columns(armonic: Armonic) -> None:
    run = armonic("update", "--help")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    headings = [line for line in run.out.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == [
        "Arguments:", "Options:", "What was measured:", "Reading the files:", "What is fitted:", "How it is fitted:"
    ]  # fmt: skip
    named = [line.split()[0] for line in run.out.splitlines() if line.startswith("  -")]
    assert len(named) == len(set(named))
    for option in (
        "--method", "--cost", "--loss", "--starts", "--seed", "--threads", "--hold", "--tie", "--prior", "--law",
        "--checkpoint", "--tolerance", "--population", "--generations", "--coherence", "--modes", "--json",
    ):  # fmt: skip
        assert option in named


def test_no_summary_of_a_command_is_cut(armonic: Armonic) -> None:
    listed = armonic("--help").out.partition("Commands:")[2].strip().splitlines()
    summaries = [line for line in listed if line.startswith("  ") and line.strip()]
    assert "..." not in "".join(listed)
    assert all(line.rstrip().endswith(".") for line in summaries)
    assert any("update" in line for line in listed)


def test_plan_takes_priors_in_the_same_words(armonic: Armonic) -> None:
    path = "links.arm.elasticity.y.damping"
    words = ("plan", TRUE, MEASURED, "--candidates", "0,70deg,-100deg", "--candidates", "20deg,50deg,-80deg", "--json")
    data = armonic(*words, "--count", "1", "--parameters", "damping", "--prior", f"{path}=3%@85").json
    assert next(p["verdicts"][0] for p in data["parameters"] if p["path"] == path) == "identified"
