"""Worlds that stand behind the same interfaces: one module for each kind of environment."""
