"""Learners: how experience becomes a better policy."""
