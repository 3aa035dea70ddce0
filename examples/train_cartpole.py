"""Train a tree on CartPole, read it, test it on Gymnasium, and keep it as a program.

python examples/train_cartpole.py [steps]
"""

import sys
from pathlib import Path

import sympol

steps = int(sys.argv[1]) if sys.argv[1:] else 1_000_000

agent = sympol.PPO("tree", "CartPole-v1", seed=0)
agent.learn(total_timesteps=steps)

tree = agent.tree()
print(tree)

mean, std = sympol.evaluate_policy(agent, "CartPole-v1", n_eval_episodes=100, seed=1)
print(f"\n{tree.n_nodes} nodes, return {mean:.1f} ± {std:.1f} over 100 episodes")

Path("cartpole_policy.py").write_text(tree.to_python())
print("written to cartpole_policy.py; try: python cartpole_policy.py 0.0 0.1 0.02 -0.1")
