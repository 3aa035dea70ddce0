"""The errors of environments."""

from __future__ import annotations


class UnknownEnvironment(ValueError):
    """No environment has this id."""


class EnvironmentFailure(RuntimeError):
    """An environment raised, or returned something that is not an observation or a reward."""


class MissingExtra(ImportError):
    """An environment needs a package that is not installed; the message has the command that installs it."""
