"""Reports of runs: what is in them is what was played; what cannot be told is refused in one line."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import sympol
from sympol.algorithms.config import Config
from sympol.cli.app import main
from sympol.envs.adapters import all_ids, built_in
from sympol.envs.registry import resolve
from sympol.evaluate import evaluate_policy
from sympol.report import compare, report
from sympol.report.episodes import filmed
from sympol.report.frames import MOST_BYTES, Frames, within_budget
from sympol.report.page import _telling
from sympol.runs.run import Run
from sympol.trees import DecisionTree

from .tiny import COLUMNS, TINY, refused
from .trees.test_report import Page

NETWORK = {name: value for name, value in TINY.items() if name != "depth"}


def pole(threshold: float = 0.0) -> DecisionTree:
    spec = resolve("CartPole-v1")
    return DecisionTree.from_complete(
        np.array([2]),
        np.array([threshold]),
        np.eye(2),
        actions=spec.actions,
        feature_names=spec.features.names,
        feature_low=spec.features.low,
        feature_high=spec.features.high,
    )


def made(path: Path, tree: DecisionTree, env: str = "CartPole-v1") -> Run:
    run = Run.create(path, resolve(env), Config(), seed=0)
    run.save_tree(tree)
    return run


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    return made(tmp_path_factory.mktemp("runs") / "pole", pole())


def observed(episode: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(episode["observations"]), "<f4").reshape(-1, 4)


def test_a_report_tells_what_was_played(run):
    data = Page(report(run, episodes=12, seed=3)).data
    returns, lengths = evaluate_policy(
        run.load_tree(), "CartPole-v1", 12, seed=3, return_episode_rewards=True
    )
    assert data["tests"]["returns"] == returns
    assert data["tests"]["mean"] == pytest.approx(np.mean(returns))
    assert data["tests"]["words"] == f"{np.mean(returns):.1f} ± {np.std(returns):.1f}"
    assert data["policy"]["visits"][0] == sum(lengths)
    played = {episode["earned"][-1] for episode in data["player"]["episodes"]}
    assert played == {min(returns), sorted(returns)[6], max(returns)}
    assert data["curve"] is None
    assert data["checks"] is None
    rows = dict(data["provenance"]["rows"])
    assert rows["environment"] == "CartPole-v1"
    assert rows["run"] == str(run.path)
    assert "num_steps" in data["provenance"]["config"]


def test_an_episode_can_be_played_again_out_of_what_is_kept(run):
    tree = run.load_tree()
    for episode in Page(report(run, episodes=5)).data["player"]["episodes"]:
        env = resolve("CartPole-v1").make_host()
        observation, _ = env.reset(seed=episode["seed"])
        x = observed(episode)
        for step in range(episode["length"]):
            assert (np.float32(observation) == x[step]).all()
            action = tree.predict(observation)
            assert episode["said"][episode["says"][step]] == tree.actions.words(action)[0]
            observation, *_ = env.step(action)
        assert (np.float32(observation) == x[-1]).all()
        assert len(x) == episode["length"] + 1 == len(episode["earned"])
        assert episode["end"] == "terminated"


def test_the_episodes_shown_are_the_median_the_worst_and_the_best():
    assert _telling(np.array([3.0, 9, 1, 5])) == {"Median of 4": 3, "Worst of 4": 2, "Best of 4": 1}
    assert _telling(np.array([7.0, 7])) == {"Episode 1 of 2": 0}
    assert _telling(np.array([7.0])) == {"The episode": 0}
    assert _telling(np.array([2.0, 1])) == {"Median of 2": 0, "Worst of 2": 1}


def test_the_training_is_drawn_as_it_was_written(run, tmp_path):
    other = made(tmp_path / "run", pole())
    names = COLUMNS
    rows = [[{"time/total_timesteps": "64", "eval/mean_reward": "8"}.get(n, "nan") for n in names],
            [{"time/total_timesteps": "128", "eval/mean_reward": "9.5"}.get(n, "nan") for n in names]]  # fmt: skip
    lines = [",".join(names), *(",".join(row) for row in rows)]
    (other.path / "metrics.csv").write_text("".join(f"{line}\r\n" for line in lines))
    curve = Page(report(other, episodes=2)).data["curve"]
    assert curve == [{"name": "validation, deterministic", "points": [[64.0, 8.0], [128.0, 9.5]]}]


def test_properties_beside_the_run_or_given_are_proven(tmp_path):
    run = made(tmp_path / "run", pole())
    (run.path / "safety.toml").write_text(
        '[[property]]\nrule = "when pole angle (rad) < -0.1 then action is push left"\n'
    )
    (tmp_path / "other.toml").write_text('[[property]]\nname = "no"\nrule = "action is always push right"\n')
    (own,) = Page(report(run, episodes=2)).data["checks"]
    assert own["holds"] is True
    assert own["counterexample"] is None
    (given,) = Page(report(run, episodes=2, properties=tmp_path / "other.toml")).data["checks"]
    assert given["holds"] is False
    example = np.frombuffer(base64.b64decode(given["counterexample"]), "<f4")
    assert run.load_tree().predict(example) == 0


def test_what_the_page_draws_is_what_python_believes_it_draws():
    script = (Path(sympol.__file__).parent / "trees" / "report" / "drawings.js").read_text(encoding="utf-8")
    table = script[script.index("const DRAWINGS") : script.index("};")]
    assert re.findall(r'"([\w-]+)":', table) == [env_id for env_id in all_ids() if built_in(env_id).drawing]


def noisy(seed: int) -> Image.Image:
    return Image.fromarray(np.random.default_rng(seed).integers(0, 256, (200, 600, 3), dtype=np.uint8))


def test_frames_fit_into_a_page_and_the_last_one_is_kept():
    episodes = []
    for episode in range(2):
        frames = Frames()
        for step in range(60):
            if frames.wants(step) or step == 59:
                frames.add(step, noisy(100 * episode + step))
        episodes.append(frames)
        assert frames.size <= MOST_BYTES
    within_budget(episodes)
    assert sum(frames.size for frames in episodes) <= MOST_BYTES
    for frames in episodes:
        data = frames.data()
        assert len(data["at"]) == 60
        assert data["at"] == sorted(data["at"])
        assert data["at"][-1] == len(data["images"]) - 1
        assert all(data["at"][step] == step // frames.stride for step in range(0, 59, frames.stride))
        assert all(image.startswith("data:image/webp;base64,") for image in data["images"])


def test_the_same_picture_is_kept_once():
    frames = Frames()
    for step in range(6):
        frames.add(step, noisy(step % 2))
    assert frames.data()["at"] == [0, 1, 0, 1, 0, 1]


def test_what_the_page_cannot_draw_comes_as_frames():
    spec = resolve("FrozenLake-v1", backend="host")
    n = len(spec.features.names)
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.5]), np.eye(4)[:2], actions=spec.actions, feature_names=spec.features.names,
        feature_low=np.zeros(n), feature_high=np.ones(n), groups=spec.features.groups,
    )  # fmt: skip
    ((episode,),), fps = filmed([tree], spec, [3], lambda words: None)
    assert 2 <= fps <= 30
    assert len(episode["frames"]["at"]) == episode["length"] + 1
    assert 1 <= len(episode["frames"]["images"]) <= episode["length"] + 1


def test_long_episodes_are_cut_so_that_the_page_stays_small(monkeypatch):
    spec = resolve("CartPole-v1", backend="host")
    monkeypatch.setattr("sympol.report.episodes.MOST_NUMBERS", 4 * 2 * 6)
    played, _ = filmed([pole(), pole()], spec, [3], lambda words: None)
    for (episode,) in played:
        assert (episode["length"], episode["end"]) == (6, "stopped")
        assert len(observed(episode)) == 7


def test_an_environment_without_pictures_is_played_without():
    spec = resolve("CartPole-v1", backend="host")
    make = spec.make_host
    assert make is not None
    blind = replace(spec, name="Blind-v0", make_host=lambda render_mode=None: make())
    ((episode,),), _ = filmed([pole()], blind, [3], lambda words: None)
    assert episode["frames"] is None
    assert len(observed(episode)) == episode["length"] + 1


def test_policies_are_compared_on_the_same_episodes(run, tmp_path):
    other = made(tmp_path / "pole", pole(0.05))
    data = Page(compare([run, other], episodes=6, seed=2)).data
    first, second = data["policies"]
    # two folders of one name are told apart
    assert [first["name"], second["name"]] == [str(run.path), str(other.path)]
    for one, of in ((first, run), (second, other)):
        returns, _ = evaluate_policy(of.load_tree(), "CartPole-v1", 6, seed=2, return_episode_rewards=True)
        assert one["tests"]["returns"] == returns
        assert [episode["earned"][-1] for episode in one["episodes"]] == returns[:2]
        assert one["size"] == {"nodes": 3, "depth": 1, "parameters": None}
    for mine, theirs in zip(first["episodes"], second["episodes"], strict=True):
        assert mine["seed"] == theirs["seed"]
        assert (observed(mine)[0] == observed(theirs)[0]).all()


@pytest.mark.slow
def test_a_network_is_compared_but_has_no_report(run, tmp_path, capsys):
    agent = sympol.PPO("mlp", "CartPole-v1", **{**NETWORK, "actor_hidden": (8,)})
    agent.learn(progress_bar=False).save(tmp_path / "network")
    path = tmp_path / "c.html"
    assert (
        main(["compare", str(run.path), str(tmp_path / "network"), "--episodes", "3", "--out", str(path)])
        == 0
    )
    _, network = Page(path.read_text(encoding="utf-8")).data["policies"]
    assert network["policy"] is None
    assert network["kind"] == "neural network (PPO)"
    assert network["size"]["parameters"] == 4 * 8 + 8 + 8 * 2 + 2
    returns, _ = evaluate_policy(agent, "CartPole-v1", 3, seed=7, return_episode_rewards=True)
    assert network["tests"]["returns"] == returns
    capsys.readouterr()
    assert "holds 'mlp', which is no tree" in refused(capsys, "report", tmp_path / "network")


def test_the_command_writes_into_the_run(run, capsys):
    assert main(["report", str(run.path), "--episodes", "3"]) == 0
    said = capsys.readouterr()
    path = run.path / "report.html"
    assert said.out == ""
    assert f"written to {path}" in said.err
    assert Page(path.read_text(encoding="utf-8")).data["title"] == "CartPole-v1"


def test_a_file_of_a_tree_has_a_page_without_episodes(run, tmp_path, capsys):
    file = tmp_path / "policy.json"
    file.write_text((run.path / "policy.json").read_text(encoding="utf-8"), encoding="utf-8")
    assert main(["report", str(file)]) == 0
    assert "written to" in capsys.readouterr().err
    assert Page((tmp_path / "policy.html").read_text(encoding="utf-8")).data["title"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["report", "RUN", "--episodes", "0"], "episodes must be at least 1, got 0"),
        (["report", "RUN", "--seed", "-1"], "seed must not be negative, got -1"),
        (["report", "RUN", "--out", "no/such/a.html"], "there is no folder no/such; choose another --out"),
        (["report", "RUN", "--out", "."], "is a folder; choose a file"),
        (["report", "nowhere"], "there is no run in nowhere"),
        (["report", "RUN", "--properties", "BAD"], "speed of the wind"),
        (["compare", "RUN"], "between 2 and 6 runs can be compared, got 1"),
        (["compare", *["RUN"] * 7], "between 2 and 6 runs can be compared, got 7"),
        (["compare", "RUN", "OTHER"], "is of CartPole-v1, "),
        (["compare", "RUN", "RUN", "--epsiodes", "1"], "did you mean --episodes?"),
    ],
)
def test_bad_input_is_refused_in_one_line(run, tmp_path, words, message, capsys):
    bad = tmp_path / "bad.toml"
    bad.write_text('[[property]]\nrule = "when speed of the wind > 1 then action is push left"\n')
    spec = resolve("MountainCar-v0")
    other = made(
        tmp_path / "other",
        DecisionTree.from_complete(
            np.array([0]), np.zeros(1), np.eye(3)[:2], actions=spec.actions, feature_names=spec.features.names
        ),
        "MountainCar-v0",
    )
    names = {"RUN": str(run.path), "OTHER": str(other.path), "BAD": str(bad)}
    assert message in refused(capsys, *(names.get(word, word) for word in words))


def test_a_missing_file_of_properties_is_said(run, capsys):
    said = refused(capsys, "report", run.path, "--properties", run.path / "none.toml", status=1)
    assert "none.toml" in said


def test_a_page_is_json_and_markup_whatever_the_run_is_called(tmp_path):
    run = made(tmp_path / "</script><b>'\"&", pole())
    page = Page(report(run, episodes=2))
    assert dict(page.data["provenance"]["rows"])["run"] == str(run.path)
    assert "b" not in [tag for tag, _ in page.elements]
    json.dumps(page.data, allow_nan=False)
