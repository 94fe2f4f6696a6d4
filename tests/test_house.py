"""Drift guards: what the docs show runs, what is public is documented, and importing stays light."""

from __future__ import annotations

import inspect
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import armonic as am

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "python" / "armonic" / "examples"
README = (ROOT / "README.md").read_text("utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_library_example_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "demo").mkdir()
    for name in ("kuka_milling.uff", "kuka_start.yaml", "taps.uff"):
        shutil.copy(EXAMPLES / name, tmp_path / "demo")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), names)
    assert isinstance(names["fit"], am.Fit)
    assert (tmp_path / "demo" / "report.html").stat().st_size > 1_000_000  # plotly's code is in it


def test_the_examples_of_the_docs_with_the_closed_loop_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "library.md").read_text("utf-8")
    codes = [code for code in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if "scompi" in code]
    names: dict[str, object] = {"am": am}
    for code in codes:
        exec(compile(code, "library.md", "exec"), names)
    assert len(codes) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["oma.html", "plane.zarr", "run.zarr", "scompi.mat"]


def test_the_robot_file_of_the_readme_is_valid_and_has_modes(tmp_path: Path) -> None:
    (text,) = blocks("yaml")
    (tmp_path / "robot.yaml").write_text(text, "utf-8")
    robot = am.load(tmp_path / "robot.yaml")
    assert am.check(robot) == ()
    assert len(am.modes(robot, "work")) == 3
    assert robot.bounds("links.boom.elasticity.z.stiffness") == (1.0e6, 9.0e6)


def test_every_local_link_of_the_docs_leads_somewhere() -> None:
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_file_that_the_docs_name_exists() -> None:
    named = re.findall(r"`((?:core|python|tests|docs|benches)/[\w/.]+)`", "".join(p.read_text("utf-8") for p in [
        ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")
    ]))  # fmt: skip
    missing = [name for name in named if not (ROOT / name).exists()]
    assert named
    assert not missing


@pytest.mark.parametrize("name", am.__all__)
def test_every_public_name_is_documented(name: str) -> None:
    thing = getattr(am, name)
    assert inspect.getdoc(thing)
    if inspect.isclass(thing):
        for member, value in inspect.getmembers(thing):
            public = not member.startswith("_") and member in vars(thing)
            if public and (inspect.isfunction(value) or isinstance(value, property)):
                assert inspect.getdoc(value), f"{name}.{member}"


def test_every_public_function_states_its_arguments_and_errors() -> None:
    for name in am.__all__:
        thing = getattr(am, name)
        if inspect.isfunction(thing):
            doc = inspect.getdoc(thing) or ""
            parameters = list(inspect.signature(thing).parameters)
            assert not parameters or "Args:" in doc, name
            missing = [p for p in parameters if not re.search(rf"\b{p}\b", doc)]
            assert not missing, f"{name}: {missing}"


def test_importing_armonic_loads_nothing_heavy() -> None:
    code = "import sys, armonic; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    heavy = {
        "numpy", "scipy", "pydantic", "plotly", "rich", "typer", "ruamel.yaml", "jinja2", "matplotlib",
        "xarray", "zarr", "lxml", "distributed",
    }  # fmt: skip
    assert not heavy.intersection(loaded)


def test_the_version_is_the_same_everywhere() -> None:
    from importlib.metadata import version

    assert am.__version__ == version("armonic")


def test_no_file_grew_past_a_head_full() -> None:
    source = [
        p for folder in ("core", "binding", "python") for p in (ROOT / folder).rglob("*") if p.suffix in (".rs", ".py")
    ]
    long = {p.name: n for p in source if (n := len(p.read_text("utf-8").splitlines())) > 450}
    assert len(source) > 30
    assert not long


@pytest.mark.parametrize("kind", [name for name in am.__all__ if name.endswith("Error")])
def test_every_error_crosses_to_another_process_whole(kind: str) -> None:
    error = getattr(am, kind)("robot.yaml, line 3", found="-1", expected="a mass", hint="Weigh it.")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.hint) == (type(error), str(error), error.hint)
