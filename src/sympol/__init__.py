"""Reinforcement learning whose policy is a decision tree you can read."""

__version__ = "0.1.0"
