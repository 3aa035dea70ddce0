"""Environments named by a file or a module of the user's."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import pytest

import sympol
from sympol.envs.errors import EnvironmentFailure, MissingExtra, UnknownEnvironment
from sympol.envs.user_code import CodeNotFound, location, names_in, short

from .tank import JAX_WALK, write_tank


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with the file tank.py, whose modules are forgotten afterwards."""
    write_tank(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = {*sys.modules}
    yield tmp_path
    for name in {*sys.modules} - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]
    gymnasium.registry.pop("Tank-v0", None)


@pytest.mark.parametrize(
    "name",
    ["tank.py:Tank", "./tank.py:make_tank", "tank:Tank", "tank:make_tank", "tank.py:Tank-v0", "tank:Tank-v0"],
)
def test_every_form_is_the_same_tank(folder: Path, name: str):
    spec = sympol.resolve(name, env_kwargs={"inflow": 0.25})
    assert spec.features.names == ("level", "pump = 0", "pump = 1")
    assert spec.name == short(name)
    assert spec.short_name == name.rpartition(":")[2]
    assert spec.origin.not_kept == ""
    assert spec.env_kwargs == {"inflow": 0.25}
    assert spec.origin.file == (str(folder / "tank.py") if ".py" in name else "")
    first, second = spec.make_host(), spec.make_host()
    assert first.unwrapped is not second.unwrapped
    assert first.get_wrapper_attr("inflow") == 0.25


def test_it_is_found_from_another_folder_and_in_another_process(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    make = sympol.resolve("tank.py:Tank").make_host
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    code = (
        "import pickle, sys; make = pickle.load(sys.stdin.buffer); print(make().action_names); "
        "print('jax' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(make), capture_output=True, check=True
    )
    assert done.stdout.decode().splitlines() == ["('off', 'on')", "False"]


def test_an_object_is_played_itself(folder: Path):
    spec = sympol.resolve("tank.py:works")
    assert spec.has_one_copy
    assert spec.make_host() is sys.modules["tank"].works


def test_a_class_in_jax_trains_inside_the_program(folder: Path):
    (folder / "walks.py").write_text(JAX_WALK)
    spec = sympol.resolve("walks.py:Walk", env_kwargs={"stride": 0.25})
    assert spec.backend == "jax"
    assert spec.origin.not_kept == ""
    assert spec.max_episode_steps == 20


def test_files_of_one_name_are_told_apart(folder: Path):
    for plant, inflow in (("north", 0.1), ("south", 0.2)):
        file = write_tank(folder / plant, "plant.py")
        file.write_text(
            file.read_text()
            .replace("inflow=0.3", f"inflow={inflow}")
            .replace("gymnasium.register(", "print(")
        )
    makes = [sympol.resolve(f"{plant}/plant.py:Tank").make_host for plant in ("north", "south")]
    assert [make().get_wrapper_attr("inflow") for make in makes] == [0.1, 0.2]


def test_a_file_may_be_called_as_a_module_of_python_is(folder: Path):
    write_tank(folder, "queue.py")
    assert sympol.resolve("queue.py:Tank").name == "queue.py:Tank"
    assert sys.modules["queue"].__file__ != str(folder / "queue.py")


def test_a_file_of_a_package_imports_its_siblings(folder: Path):
    package = folder / "works" / "plants"
    write_tank(package)
    for part in (folder / "works", package):
        (part / "__init__.py").touch()
    (package / "large.py").write_text(
        "from .tank import Tank\nfrom ..sizes import SIZE\n\ndef make():\n    return Tank(SIZE)\n"
    )
    (folder / "works" / "sizes.py").write_text("SIZE = 0.5\n")
    make = sympol.resolve("works/plants/large.py:make").make_host
    assert make().get_wrapper_attr("inflow") == 0.5


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("tank.py:Tnak", "tank.py has no 'Tnak'; did you mean Tank\\?"),
        ("tank:make_tnak", "module tank has no 'make_tnak'; did you mean make_tank\\?"),
        ("tank:Tank-v1", "did you mean Tank or Tank-v0"),
        ("tnak.py:Tank", "there is no file .*tnak.py; did you mean tank.py\\?"),
        ("plants/tank.py:Tank", "there is no folder .*plants"),
        ("tnak:Tank", "there is no module tnak; is its folder on PYTHONPATH"),
        ("tank.py:capacity", "tank.py:capacity is no environment: it is 3; name a class"),
        (
            "tank.py:make_nothing",
            "make_nothing must make an environment, which has reset and step, but it made None",
        ),
    ],
)
def test_what_is_not_there_is_said_with_what_is(folder: Path, name: str, message: str):
    with pytest.raises(UnknownEnvironment, match=message) as raised:
        sympol.resolve(name)
    assert "\n" not in str(raised.value)


def test_a_file_alone_is_no_environment(folder: Path):
    with pytest.raises(
        CodeNotFound, match=r"tank.py is a file; say what in it is meant: did you mean tank.py:Tank"
    ):
        sympol.resolve("tank.py")
    assert "tank" not in sys.modules


def test_arguments_that_do_not_fit_are_named(folder: Path):
    with pytest.raises(ValueError, match=r"tank.py:Sized needs size: --env-kwargs size=VALUE"):
        sympol.resolve("tank.py:Sized")
    assert sympol.resolve("tank.py:Sized", env_kwargs={"size": 2}).env_kwargs == {"size": 2}
    with pytest.raises(ValueError, match=r"tank.py:make_tank takes inflow, got env_kwargs \{'outflow': 1\}"):
        sympol.resolve("tank.py:make_tank", env_kwargs={"outflow": 1})


def test_the_line_of_an_error_is_said(folder: Path):
    with pytest.raises(
        EnvironmentFailure,
        match=r"make_trouble cannot be made: AttributeError: .*pipes.*\(tank.py, line \d+\)",
    ):
        sympol.resolve("tank.py:make_trouble")
    (folder / "bad.py").write_text("import gymnasium\n\nx = level + 1\n")
    with pytest.raises(ImportError, match=r"NameError: name 'level' is not defined \(bad.py, line 3\)"):
        sympol.resolve("bad.py:Tank")
    (folder / "worse.py").write_text("x = 1\ny = (\n")
    with pytest.raises(ImportError, match=r"SyntaxError: .* \(worse.py, line 2\)"):
        sympol.resolve("worse.py:Tank")
    (folder / "needy.py").write_text("import no_such_package_here\n")
    with pytest.raises(MissingExtra, match="needs no_such_package_here, which is not installed"):
        sympol.resolve("needy.py:Tank")


def test_names_are_read_without_running_the_file(folder: Path):
    (folder / "exits.py").write_text(
        "raise SystemExit\nclass A: ...\n_b = 1\nc: int = 2\nregister(id='D-v0')\n"
    )
    assert list(names_in(folder / "exits.py")) == ["A", "c", "D-v0"]
    assert location("exits") == folder / "exits.py"
    assert location("tank.py") == folder / "tank.py"
    assert location("no_such_module") is None
