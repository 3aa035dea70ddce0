"""Pytrees with a forward pass: the actors and the critic."""
