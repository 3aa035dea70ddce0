"""Placeholder."""


class Algorithm:
    """Placeholder."""
