"""Evaluators: the return of trees on the same episodes, on whatever plays the environment fastest."""
