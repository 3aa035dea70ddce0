"""From training to a controller in C: find a flaw, prove it gone, keep what was learnt, and let the C drive Gymnasium.

python examples/ship_a_controller.py [TIMESTEPS]

Needs a C compiler; writes controller.c and controller.h into the current folder.
"""

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path

import gymnasium
import numpy as np
from rich.console import Console

import sympol
from sympol.play import play
from sympol.trees.diff import diff
from sympol.trees.export.c import to_c, to_c_header
from sympol.trees.override import override

say = Console(highlight=False, markup=False, soft_wrap=True).print

ENV = "CartPole-v1"
TIMESTEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
FAR_RIGHT, FAR_LEFT = "pole angle (rad) > 0.15", "pole angle (rad) < -0.15"
SAFETY = [f"when {FAR_RIGHT} then action is push right", f"when {FAR_LEFT} then action is push left"]


def report(step, tree):
    """What a tree earns, how large it is, and what is proven about it."""
    mean, std = sympol.evaluate_policy(tree, ENV, n_eval_episodes=100, seed=7)
    say(f"\n{step}: return {mean:.1f} ± {std:.1f} over 100 episodes, {tree.n_nodes} nodes\n")
    for verdict in tree.verify(*SAFETY):
        say(str(verdict))


class Compiled:
    """The C program as a policy: what Gymnasium observes goes to it as it is, what it answers goes back."""

    def __init__(self, source, folder):
        library = Path(folder) / "controller.so"
        subprocess.run(["cc", "-std=c99", "-O2", "-shared", "-fPIC", "-o", library, source], check=True)
        self.decide = ctypes.CDLL(str(library)).controller_act

    def __call__(self, observation):
        x = np.ascontiguousarray(observation, np.float32)
        return self.decide(x.ctypes.data_as(ctypes.POINTER(ctypes.c_float)))


# 1. Train, and look: the tree is good, and the pole may lean far to the right while it pushes left.
agent = sympol.PPO("tree", ENV, seed=0).learn(TIMESTEPS)
trained = agent.tree()
say(str(trained))
report("trained", trained)

# 2. Put both rules on top, by hand. It is proven at once that they hold, and what else changed is said.
ruled = override(override(trained, FAR_RIGHT, "push right").tree, FAR_LEFT, "push left").tree
report("with the rules forced", ruled)
visited = play(trained, sympol.resolve(ENV), 20, seed=3, purpose="validation").observations
say(f"\n{diff(trained, ruled, visited)}")

# 3. Train on from there, the rules frozen: whatever else is learnt, they stay.
rules = f"{FAR_RIGHT} or {FAR_LEFT}"
tuned = sympol.PPO("tree", ENV, seed=1, start=ruled, freeze=rules).learn(TIMESTEPS // 4).tree()
say(f"\n{tuned}")
report("trained on, the rules frozen", tuned)

# 4. Ship it: C99 without libraries, and the same program in the loop with Gymnasium, step by step beside the tree.
Path("controller.c").write_text(to_c(tuned, name="controller"), encoding="utf-8")
Path("controller.h").write_text(to_c_header(tuned, name="controller"), encoding="utf-8")
with tempfile.TemporaryDirectory() as folder, gymnasium.make(ENV) as env:
    policy, returns, different = Compiled("controller.c", folder), [], 0
    for episode in range(20):
        observation, _ = env.reset(seed=10_000 + episode)
        total, done = 0.0, False
        while not done:
            action = policy(observation)
            different += action != tuned.predict(observation)
            observation, reward, terminated, truncated, _ = env.step(action)
            total, done = total + float(reward), terminated or truncated
        returns.append(total)
say(
    f"\nthe C in the loop: return {np.mean(returns):.1f} over 20 episodes, {different} actions other than the tree's"
)
