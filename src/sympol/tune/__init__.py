"""Hyperparameter search: spaces, a study that several processes share, its report."""
