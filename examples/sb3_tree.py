"""A decision tree trained by stable-baselines3's own PPO on CartPole, and read afterwards: pip install 'sympol[sb3]'.

python examples/sb3_tree.py [steps] [seed]
"""

import sys

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from sympol.frameworks import TreePolicy, warm_up

steps, seed = (int(sys.argv[i]) if sys.argv[i:] else default for i, default in ((1, 160_000), (2, 0)))

model = PPO(
    TreePolicy,
    make_vec_env("CartPole-v1", n_envs=16, seed=seed),
    learning_rate=lambda remaining: 0.002 * remaining,  # the critic's; the tree's follow its course
    n_steps=128,
    batch_size=256,
    n_epochs=8,
    ent_coef=0.005,
    max_grad_norm=1e9,  # one norm over tree and critic would let the critic's gradient decide for both
    policy_kwargs={
        "depth": 5,
        "threshold_std": 0.2,
        "learning_rates": {"feature_logits": 0.03, "thresholds": 0.005, "leaf_values": 0.03},
        **warm_up("CartPole-v1"),
    },
    seed=seed,
    device="cpu",
)
model.learn(steps)

tree = model.policy.to_tree("CartPole-v1").prune()
mean, std = evaluate_policy(
    model, make_vec_env("CartPole-v1", n_envs=8, seed=10_000 + seed), n_eval_episodes=100
)
print(tree)
print(f"\n{tree.n_nodes} nodes, return {mean:.1f} ± {std:.1f} over 100 episodes")
