"""Films are files that open elsewhere, and show what the tree did."""

from __future__ import annotations

import os
import shutil
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from PIL import Image

import sympol
from sympol.algorithms.config import Config
from sympol.cli.app import main
from sympol.envs.registry import resolve
from sympol.film import files, record
from sympol.film import frame_layout as screen
from sympol.film.rendering import rendering
from sympol.play import play
from sympol.runs.run import Run
from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.plot import PathPictures

from .trees.samples import HOSTILE_NAMES

BALANCE = DecisionTree.from_complete(
    np.array([3]), np.array([0.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]),
    actions=DiscreteActions(2, ("push left", "push right")), feature_low=np.full(4, -np.inf),
)  # fmt: skip


class Walk(gymnasium.Env):
    """A place on a line, drawn as one bright column; both ways lead on."""

    observation_space, action_space = Box(-50, 50, (1,)), Discrete(2)
    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, length: int = 6, frame: Any = None):
        self.render_mode, self.length, self.frame = render_mode, length, frame

    def reset(self, *, seed=None, options=None):
        self.at, self.step_number = 0, 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.at += 2 * int(action) - 1
        self.step_number += 1
        return np.float32([self.at]), 1.0, self.step_number >= self.length, False, {}

    def render(self):
        if self.frame is not None:
            return self.frame
        picture = np.zeros((8, 32, 3), np.uint8)
        picture[:, 16 + self.at % 16] = 255
        return picture


def walker(names: tuple[str, ...] = ("left", "right"), feature: str = "place") -> DecisionTree:
    """Goes right from the left half and left from the right one."""
    return DecisionTree.from_complete(
        np.array([0]), np.array([0.0]), np.array([[0.0, 1.0], [1.0, 0.0]]),
        actions=DiscreteActions(2, names), feature_names=[feature],
    )  # fmt: skip


def opened(path) -> list[Image.Image]:
    frames = []
    with Image.open(path) as film:
        for i in range(film.n_frames):  # pyright: ignore[reportAttributeAccessIssue]
            film.seek(i)
            frames.append(film.convert("RGB"))
    return frames


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_a_film_has_a_frame_a_step_and_the_end(suffix, tmp_path):
    path = tmp_path / f"episode.{suffix}"
    film = sympol.watch(walker(), Walk, path, fps=5)
    assert film[:5] == (path, [6.0], [6], 7, 1)
    assert film.size == path.stat().st_size
    frames = opened(path)
    assert len(frames) == 7
    assert len({frame.size for frame in frames}) == 1
    assert len({frame.tobytes() for frame in frames}) == 7
    times = []
    with Image.open(path) as again:
        for i in range(7):
            again.seek(i)
            again.load()
            times.append(again.info["duration"])
        assert again.info["loop"] == 0
    assert times == [200] * 6 + [1500]
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_the_same_episode_is_the_same_file(suffix, tmp_path):
    paths = [tmp_path / f"{name}.{suffix}" for name in "ab"]
    for path in paths:
        sympol.watch(BALANCE, "CartPole-v1", path, seed=3, max_steps=5)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_colours_are_those_of_the_pictures(tmp_path):
    """The white of the paper stays white in the 256 colours of a GIF, and so does the environment."""
    red = np.zeros((240, 240, 3), np.uint8) + np.uint8([200, 10, 30])
    sympol.watch(walker(), partial(Walk, length=2, frame=red), tmp_path / "a.gif")
    for frame in opened(tmp_path / "a.gif"):
        assert frame.getpixel((1, 1)) == (255, 255, 255)
        assert np.abs(np.subtract(frame.getpixel((100, 100)), (200, 10, 30))).max() <= 8


def test_the_way_lit_is_that_of_the_observation(tmp_path, monkeypatch):
    """Of every step's observation, and of none at the end."""
    shown: list[Any] = []
    draw = screen.FrameLayout.draw

    def spy(self, shot):
        shown.append(shot)
        return draw(self, shot)

    monkeypatch.setattr(screen.FrameLayout, "draw", spy)
    film = sympol.watch(BALANCE, "CartPole-v1", tmp_path / "a.webp", seed=3, max_steps=9)
    *steps, end = shown
    spec = resolve("CartPole-v1", backend="host")
    seen = play(BALANCE, spec, 1, seed=3).observations[: len(steps)]
    assert np.array_equal([shot.observation for shot in steps], seen)
    assert (end.observation, end.is_last, film.lengths) == (None, True, [9])
    said = [shot.caption.split("   ")[1] for shot in steps]
    assert said == [BALANCE.actions.words(action)[0] for action in BALANCE.predict(seen)]
    assert [shot.earned for shot in shown] == [f"return {i}.00" for i in range(10)]
    assert end.caption == "stopped after 9 steps"


def test_the_tree_is_drawn_once_a_leaf_and_differs_between_leaves(monkeypatch):
    drawn = []
    way = PathPictures.path_to
    monkeypatch.setattr(PathPictures, "path_to", lambda ways, leaf: drawn.append(leaf) or way(ways, leaf))
    frame = screen.env_picture(Image.new("RGB", (8, 8)))
    on = screen.FrameLayout(frame.size, walker())
    pictures = [on.draw(screen.Shot(frame, np.array([x]), "", "", 0)) for x in (-1.0, 1.0, -2.0, 3.0)]
    assert drawn == [1, 2]
    assert pictures[0] == pictures[2] != pictures[1] == pictures[3]


def test_a_tree_too_large_to_be_made_out_is_left_out(tmp_path):
    tree = DecisionTree.from_complete(
        np.zeros(511, int), np.arange(511.0), np.eye(2)[np.arange(512) % 2], actions=DiscreteActions(2)
    )
    assert tree.n_nodes > screen.LARGEST_TREE
    assert screen.FrameLayout((240, 240), tree).size == screen.FrameLayout((240, 240), None).size
    assert sympol.watch(tree, Walk, tmp_path / "a.gif", max_steps=2).frames == 3


def test_anything_with_predict_is_watched_without_a_tree(tmp_path):
    class OneByOne:
        def predict(self, observation, deterministic=True):
            return BALANCE.predict(observation), None

    with_tree = sympol.watch(BALANCE, "CartPole-v1", tmp_path / "tree.gif", max_steps=4)
    without = sympol.watch(OneByOne(), "CartPole-v1", tmp_path / "none.gif", max_steps=4)
    assert with_tree[1:4] == without[1:4]
    assert opened(without.path)[0].width < opened(with_tree.path)[0].width


def test_an_agent_knows_what_to_play_on(tmp_path):
    class Agent:
        spec = resolve(Walk)
        has_tree = True

        def tree(self, *, prune=True):
            return walker()

        def act(self, x, *, deterministic, rng):
            return walker().predict(x)

    assert sympol.watch(Agent(), path=tmp_path / "a.gif").lengths == [6]  # pyright: ignore
    with pytest.raises(ValueError, match="env must be given"):
        sympol.watch(walker(), path=tmp_path / "a.gif")


def test_evaluation_renders_its_first_episode(tmp_path):
    path = tmp_path / "first.gif"
    plain = sympol.evaluate_policy(walker(), Walk, 2, return_episode_rewards=True)
    assert sympol.evaluate_policy(walker(), Walk, 2, return_episode_rewards=True, render=path) == plain
    assert len(opened(path)) == plain[1][0] + 1


@pytest.mark.parametrize("deterministic", [True, False])
def test_the_episodes_are_those_of_the_evaluation(deterministic, tmp_path):
    given = {"seed": 5, "deterministic": deterministic}
    fall = replace(BALANCE, value=BALANCE.value[:, ::-1])
    returns, _ = sympol.evaluate_policy(fall, "CartPole-v1", 2, return_episode_rewards=True, **given)
    film = sympol.watch(fall, "CartPole-v1", tmp_path / "a.gif", episodes=2, **given)
    assert len(film.returns) == 2
    if deterministic:  # samples of episodes played side by side are drawn in another order
        assert film.returns == returns


def test_long_episodes_are_shown_every_few_steps_at_their_own_pace(tmp_path, monkeypatch):
    monkeypatch.setattr(record, "MOST_FRAMES", 10)
    film = sympol.watch(walker(), partial(Walk, length=50), tmp_path / "a.gif", fps=20)
    assert (film.lengths, film.stride, film.frames) == ([50], 8, 8)  # steps 0, 8, …, 48 and the end
    with Image.open(tmp_path / "a.gif") as again:
        assert (again.n_frames, again.info["duration"]) == (8, 400)  # pyright: ignore


def test_large_files_become_smaller(tmp_path, monkeypatch):
    whole = sympol.watch(walker(), partial(Walk, length=40), tmp_path / "a.gif")
    monkeypatch.setattr(record, "MOST_BYTES", whole.size * 2 // 3)
    film = sympol.watch(walker(), partial(Walk, length=40), tmp_path / "a.gif")
    assert film.size <= whole.size * 2 // 3
    assert film.frames < whole.frames == 41
    monkeypatch.setattr(record, "MOST_BYTES", 1)  # as small as it gets
    assert sympol.watch(walker(), Walk, tmp_path / "a.gif").frames == 2


def test_hostile_names_do_not_break_pictures(tmp_path):
    frame = Image.new("RGB", (8, 8))
    alone = screen.FrameLayout(frame.size, None)
    for name in (*HOSTILE_NAMES, "x" * 10_000):
        assert alone.draw(screen.Shot(frame, None, name, name, 0)).size == alone.size
    together = " ".join(HOSTILE_NAMES)
    tree = walker((together, "y"), together)
    spec = resolve(Walk, action_names=list(tree.actions.names))
    assert sympol.watch(tree, spec, tmp_path / "a.gif", max_steps=2).frames == 3


@pytest.mark.parametrize("size", [(1, 1), (3, 700), (900, 2), (160, 160), (1001, 333)])
def test_frames_of_every_size(size, tmp_path):
    frame = np.zeros((*size, 3), np.uint8)
    sympol.watch(walker(), partial(Walk, length=2, frame=frame), tmp_path / "a.gif")
    width, height = opened(tmp_path / "a.gif")[0].size
    assert (width % 2, height % 2) == (0, 0)
    assert max(width, height) < 1300


class Blind(gymnasium.Env):
    """Takes the argument, as the tutorial's environments do, but draws nothing."""

    observation_space, action_space = Box(-1, 1, (1,)), Discrete(2)
    metadata = {"render_modes": ["ansi"]}  # noqa: RUF012

    def __init__(self, render_mode=None):
        assert render_mode is None or render_mode in self.metadata["render_modes"]

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}


@pytest.mark.parametrize(
    ("env", "message"),
    [
        (Blind, r"Blind does not draw itself as pictures: of the modes in its metadata, \['ansi'\], none is"),
        (Walk(), "make the object with render_mode='rgb_array'"),
        (lambda: Walk(), "let the function that makes it take render_mode='rgb_array' and pass it on"),
        (lambda **kw: Walk(**kw, frame="a text"), r"render\(\) must return an array .*, got str"),
        (lambda **kw: Walk(**kw, frame=np.zeros((4, 4))), r"got an array of shape \(4, 4\)"),
    ],
)
def test_what_draws_nothing_is_refused(env, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        sympol.watch(walker(), env, tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


def test_a_user_s_own_object_stays_open_and_factories_may_have_been_told(tmp_path):
    mine = Walk("rgb_array")
    assert sympol.watch(walker(), mine, tmp_path / "a.gif").lengths == [6]
    assert mine.render().shape == (8, 32, 3)
    assert sympol.watch(walker(), lambda: Walk("rgb_array"), tmp_path / "a.gif").lengths == [6]
    made = gymnasium.make("CartPole-v1")  # remade, this time with pictures
    assert sympol.watch(BALANCE, made, tmp_path / "a.gif", max_steps=2).lengths == [2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"path": "a.avi"}, r"a film is saved as .gif, .webp, .mp4, got 'a.avi'"),
        ({"episodes": 0}, "episodes must be between 1 and 100"),
        ({"episodes": 101}, "episodes must be between 1 and 100"),
        ({"fps": 0}, "fps must be between 0.1 and 50, got 0"),
        ({"fps": float("nan")}, "fps must be between"),
        ({"max_steps": 0}, "max_steps must be at least 1, got 0"),
        ({"seed": -1}, "seed must not be negative, got -1"),
    ],
)
def test_bad_input_is_refused_before_anything_is_played(arguments, message):
    def played(render_mode=None):
        raise AssertionError

    spec = resolve(Walk)
    object.__setattr__(spec, "make_host", played)
    with pytest.raises(ValueError, match=message):
        sympol.watch(walker(), spec, **{"path": "a.gif", **arguments})
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        sympol.watch(walker(), spec, "no/such/folder/a.gif")


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")

    def fails(path, pictures, milliseconds):
        path.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setitem(files._WRITERS, ".gif", fails)
    with pytest.raises(OSError, match="disk full"):
        sympol.watch(walker(), Walk, path)
    assert (path.read_bytes(), os.listdir(tmp_path)) == (b"old", ["a.gif"])


def test_an_mp4_without_a_codec_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[video\]', or choose a \.gif or \.webp"):
        sympol.watch(walker(), Walk, tmp_path / "a.mp4")


@pytest.mark.filterwarnings(r"ignore:os\.fork\(\) was called:RuntimeWarning")  # what reads it is a fork, too
def test_an_mp4_can_be_read_again(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "a.mp4"
    film = sympol.watch(walker(), Walk, path, fps=10)
    reader = ffmpeg.read_frames(str(path))
    about = next(reader)
    reader.close()
    assert about["codec"] == "h264"
    assert about["fps"] == 10
    assert about["duration"] == pytest.approx(0.6 + 1.5, abs=0.1)
    assert film.size == path.stat().st_size


def test_pygame_needs_no_screen_and_the_user_s_choice_stays(monkeypatch):
    spec = resolve("CartPole-v1", backend="host")
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    with rendering(spec):
        assert os.environ["SDL_VIDEODRIVER"] == "dummy"
    assert "SDL_VIDEODRIVER" not in os.environ
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    with rendering(spec):
        assert os.environ["SDL_VIDEODRIVER"] == "x11"


def test_frozen_lake_is_watched_where_there_is_no_screen(tmp_path):
    spec = resolve("FrozenLake-v1", backend="host")
    n = len(spec.features.names)
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.5]), np.eye(4)[:2], actions=spec.actions, feature_names=spec.features.names,
        feature_low=np.zeros(n), feature_high=np.ones(n), groups=spec.features.groups,
    )  # fmt: skip
    film = sympol.watch(tree, spec, tmp_path / "a.gif", max_steps=3)
    assert film.frames == film.lengths[0] + 1


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run's folder without the training."""
    path = tmp_path_factory.mktemp("runs") / "one"
    Run.create(path, resolve("CartPole-v1"), Config(), seed=0).save_tree(BALANCE)
    return path


def test_the_command_writes_into_the_run_and_plays_what_eval_plays(run, capsys):
    assert main(["watch", str(run), "--max-steps", "3"]) == 0
    said = capsys.readouterr()
    assert said.out == "CartPole-v1: return 3.00 in 3 steps (seed 7)\n"
    assert f"written to {run / 'episode.gif'} (4 frames, 0." in said.err
    assert len(opened(run / "episode.gif")) == 4


def test_the_command_takes_another_file_and_more_episodes(run, tmp_path, capsys):
    path = tmp_path / "[red]two.webp"
    words = ["--out", str(path), "--episodes", "2", "--max-steps", "2", "--fps", "4", "--seed", "1"]
    assert main(["watch", str(run), *words]) == 0
    assert len(opened(path)) == 6
    assert str(path) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "a.avi"], "error: a film is saved as .gif, .webp, .mp4, got 'a.avi'"),
        (
            ["--out", "no/such/a.gif"],
            "error: cannot write no/such/a.gif: there is no folder no/such; choose another",
        ),
        (["--episodes", "0"], "error: episodes must be between 1 and 100 in one film, got 0"),
        (["--epsiodes", "1"], "did you mean --episodes?"),
    ],
)
def test_the_command_refuses_in_one_line(run, words, message, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["watch", str(run), *words])
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    assert message in said
    assert said.count("\n") == 1


def test_the_command_says_what_to_install(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(SystemExit) as stopped:
        main(["watch", str(run), "--out", str(tmp_path / "a.mp4")])
    assert stopped.value.code == 1
    assert "pip install 'sympol[video]'" in capsys.readouterr().err


def test_a_minigrid_s_view_is_shown_beside_it(tmp_path):
    pytest.importorskip("minigrid")
    spec = resolve("MiniGrid-LavaGapS5-v0", backend="host")
    features = spec.features
    front = next(group for group in features.groups if group.name == "front")
    tree = DecisionTree.from_complete(
        np.array([front.features[front.categories.index("lava")]]), np.array([0.5]), np.eye(3)[[2, 1]],
        actions=spec.actions, feature_names=features.names, feature_low=features.low,
        feature_high=features.high, groups=features.groups,
    )  # fmt: skip
    film = sympol.watch(tree, spec, tmp_path / "a.gif", max_steps=4)
    assert film.frames == film.lengths[0] + 1
