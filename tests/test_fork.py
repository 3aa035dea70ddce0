"""In a process forked after a training trees predict as everywhere, and what needs JAX says so and does not hang."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sympol

PROGRAM = """
import multiprocessing, warnings
warnings.filterwarnings("ignore", "os.fork")  # which JAX says of every fork
import numpy as np, sympol
tiny = dict(total_timesteps=64, num_envs=2, num_steps=16, minibatch_size=32, num_evals=1, num_eval_episodes=1)
tiny |= dict(critic_hidden=(4,), num_epochs=1, progress_bar=False)
progress = tiny.pop("progress_bar")
tree = sympol.PPO("tree", "CartPole-v1", depth=2, **tiny).learn(progress_bar=progress)
mlp = sympol.PPO("mlp", "CartPole-v1", actor_hidden=(4,), **tiny).learn(progress_bar=progress)
x = np.linspace(-1, 1, 20, dtype=np.float32).reshape(5, 4)

def learn(): sympol.PPO("tree", "CartPole-v1", depth=2, **tiny).learn(progress_bar=progress)

TASKS = {
    "tree predicts": lambda: tree.tree().predict(x).tolist() == EXPECTED or "another answer",
    "agent predicts": lambda: tree.predict(x)[0].tolist() == EXPECTED or "another answer",
    "tree is played": lambda: sympol.evaluate_policy(tree.tree(), "CartPole-v1", n_eval_episodes=1)[0] > 0,
    "agent learns": learn,
    "mlp predicts": lambda: mlp.predict(x),
}
EXPECTED = tree.predict(x)[0].tolist()

def child(name, answers):
    try:
        answers.put(f"{name}: {TASKS[name]()}")
    except BaseException as error:
        answers.put(f"{name}: {type(error).__name__}: {error}")

context = multiprocessing.get_context("fork")
for name in TASKS:
    answers = context.SimpleQueue()
    process = context.Process(target=child, args=(name, answers))
    process.start()
    process.join(30)
    print(answers.get() if not answers.empty() else f"{name}: hangs", flush=True)
    process.kill()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.slow
def test_after_a_training_a_forked_process_predicts_and_says_that_it_cannot_train():
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(sympol.__file__).parents[1]),
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
    }
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240, check=False)
    said = done.stdout.splitlines()
    assert said[:3] == ["tree predicts: True", "agent predicts: True", "tree is played: True"], done.stderr
    refusal = "RuntimeError: JAX cannot compute in a process that was forked from one in which it had computed; start"
    assert [line.partition(": ")[2].startswith(refusal) for line in said[3:]] == [True, True], said
