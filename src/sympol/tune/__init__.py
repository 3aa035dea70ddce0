"""Hyperparameter search: its spaces, a study that several processes share, and its report."""
