"""What the processes of test_interrupted train on: import it and the ids are there."""

import gymnasium

gymnasium.register("HostCartPole-v0", "gymnasium.envs.classic_control:CartPoleEnv", max_episode_steps=500)
