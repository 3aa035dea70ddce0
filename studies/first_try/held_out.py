"""Environments that took no part in the development of the defaults, by letter."""

from __future__ import annotations

from .tasks import Task

TASKS: tuple[Task, ...] = ()
