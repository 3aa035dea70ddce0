"""Train a soft decision tree and a hard one on CartPole, and draw them beside each other.

python examples/soft_tree_beside_tree.py [steps] [picture]
"""

import sys
from pathlib import Path

import sympol
from sympol.distill.picture import plot_beside
from sympol.play import play
from sympol.teachers import soft_view

ENV = "CartPole-v1"
steps = int(sys.argv[1]) if sys.argv[1:] else 400_000
picture = Path(sys.argv[2] if sys.argv[2:] else "sdt-beside-tree.svg")

soft = sympol.PPO("sdt", ENV, seed=0, depth=3).learn(steps)
hard = sympol.PPO("tree", ENV, seed=0).learn(steps)
made_hard = sympol.distill_policy(soft, "discretize")  # what is left when only the heaviest feature counts

for name, policy in (("soft", soft), ("hard", hard), ("soft, made hard", made_hard)):
    mean, std = sympol.evaluate_policy(policy, ENV, n_eval_episodes=100, seed=1)
    print(f"{name:<16} {mean:6.1f} ± {std:5.1f} over 100 episodes")

view = soft_view(soft).with_shares_of(play(soft, soft.spec, 20, seed=1).observations)
tree = hard.tree().with_visits(play(hard, hard.spec, 20, seed=1).observations)
plot_beside(view, tree, picture)
print(f"written to {picture}")
