"""Describe how an environment was made, and whether that makes the same one again.

An environment that a user gives is never replaced by another one. A copy of an object is used only where nothing tells
it from the object (`sympol.envs.equality`), and a run that cannot make its environment again says so.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
from gymnasium.envs.registration import WrapperSpec

from .arguments import CannotKeep, to_plain
from .equality import WITHOUT_EFFECT, are_equal, step_limit
from .origin import Origin, Wrapping

KEPT_WRAPPERS = (
    "ClipAction",
    "ClipReward",
    "DelayObservation",
    "DtypeObservation",
    "FilterObservation",
    "FlattenObservation",
    "FrameStackObservation",
    "RescaleAction",
    "RescaleObservation",
    "ReshapeObservation",
    "StickyAction",
    "TimeAwareObservation",
)
"""Gymnasium's wrappers that a run's folder may name: they write no files and carry nothing from one episode to the
next, unlike those that normalize by statistics they gather; a time limit means the same inside and outside of them."""


_LARGEST = 1000
"""Observations that a wrapper stacks or delays; each is kept in memory."""


def describe(
    env: gymnasium.Env, remake: Callable[[str, Mapping[str, Any]], gymnasium.Env], given_as: str
) -> Origin:
    """Describe an environment that was given as an object or by a function.

    Args:
        env: The environment.
        remake: Makes an environment by its id and arguments, as loading a run does.
        given_as: What the user gave, for messages, such as ``"an object of class Tank"``.

    Returns:
        Its origin, with ``not_kept`` where what is made again cannot be proven to be the same.
    """
    spec = env.spec
    registered = None if spec is None else gymnasium.registry.get(spec.id)
    if spec is None or registered is None:
        return Origin(not_kept=given_as)
    kwargs = {
        name: value
        for name, value in spec.kwargs.items()
        if name != "render_mode"
        and not (name in registered.kwargs and are_equal(value, registered.kwargs[name]))
    }
    if (limit := step_limit(env)) != registered.max_episode_steps:
        kwargs["max_episode_steps"] = -1 if limit is None else limit
    kept = Origin.of_arguments(kwargs)
    if kept.not_kept:
        return kept
    try:
        with _quietly():
            made = remake(spec.id, {**kwargs, **_render_mode(spec.kwargs)})
    except Exception as error:
        return Origin(not_kept=f"{given_as}, and {spec.id} cannot be made by its id ({error})")
    try:
        inner = () if made.spec is None else made.spec.additional_wrappers
        wrappers = _kept(spec.additional_wrappers[len(inner) :])
        if isinstance(wrappers, str):
            return Origin(not_kept=wrappers)
        made = wrap(made, wrappers)
        if not are_same(env, made):
            return Origin(
                not_kept=f"{given_as}, which is not what {spec.id} makes: it was changed afterwards"
            )
        return Origin(kwargs, wrappers)
    finally:
        made.close()


def wrap(env: gymnasium.Env, wrappers: Sequence[Wrapping]) -> gymnasium.Env:
    """Put wrappers around an environment.

    Args:
        env: The environment.
        wrappers: The wrappers, from the innermost.

    Returns:
        The outermost wrapper.

    Raises:
        ValueError: A wrapper is none of the `KEPT_WRAPPERS`, or this version of Gymnasium does not have it.
    """
    for name, kwargs in wrappers:
        if name not in KEPT_WRAPPERS or not hasattr(gymnasium.wrappers, name):
            raise ValueError(f"wrapper must be one of {', '.join(KEPT_WRAPPERS)}, got {name!r}")
        if any(isinstance(value, int) and value > _LARGEST for value in kwargs.values()):
            raise ValueError(f"arguments of {name} must be at most {_LARGEST:,}, got {dict(kwargs)}")
        with _quietly():
            env = getattr(gymnasium.wrappers, name)(env, **kwargs)
    return env


def copier(env: gymnasium.Env) -> Callable[[], gymnasium.Env] | None:
    """Return a function that makes copies of an environment object.

    Args:
        env: The object.

    Returns:
        The function, or None where copies are not proven to be the same.
    """
    spec = env.spec
    if spec is None:
        return None

    def make(**kwargs: Any) -> gymnasium.Env:
        with _quietly():
            return gymnasium.make(spec, disable_env_checker=True, **kwargs)

    try:
        made = make()
    except Exception:  # a wrapper may have kept its arguments to itself; the simulator may have one licence
        return None
    try:
        return make if are_same(env, made) else None
    finally:
        made.close()


def are_same(env: gymnasium.Env, made: gymnasium.Env) -> bool:
    """Return whether a user's environment and one that was made just now are equal, if need be after a reset.

    Args:
        env: The user's environment.
        made: The other one.

    Returns:
        True if they are.
    """
    if are_equal(env, made):
        return True
    try:  # it may have been played already
        env.reset(seed=0)
        made.reset(seed=0)
    except Exception:
        return False
    return are_equal(env, made)


def _kept(wrappers: Sequence[WrapperSpec]) -> tuple[Wrapping, ...] | str:
    """Return the wrappers as they can be kept, or the reason why one cannot."""
    kept = []
    for wrapper in wrappers:
        if wrapper.name in [kind.__name__ for kind in WITHOUT_EFFECT]:
            continue
        ours = getattr(gymnasium.wrappers, wrapper.name, None)
        known = ours is not None and wrapper.entry_point == f"{ours.__module__}:{ours.__name__}"
        if not known or wrapper.name not in KEPT_WRAPPERS or wrapper.kwargs is None:
            return f"in a wrapper that a folder cannot keep, {wrapper.entry_point}"
        try:
            to_plain(dict(wrapper.kwargs), f"arguments of {wrapper.name}")
        except CannotKeep as problem:
            return f"in a wrapper that a folder cannot keep: {problem}"
        kept.append(Wrapping(wrapper.name, wrapper.kwargs))
    return tuple(kept)


def _render_mode(kwargs: Mapping[str, Any]) -> dict[str, Any]:
    return {} if kwargs.get("render_mode") is None else {"render_mode": kwargs["render_mode"]}


def _quietly() -> warnings.catch_warnings:
    """Silence what Gymnasium says of every environment it makes, because it has said so of the user's."""
    return warnings.catch_warnings(action="ignore")


def make_wrapped(
    make: Callable[..., gymnasium.Env], wrappers: Sequence[Wrapping], **options: Any
) -> gymnasium.Env:
    """Make an environment and put wrappers around it.

    Args:
        make: A function that makes the environment.
        wrappers: The wrappers, from the innermost.
        options: Arguments of the function.

    Returns:
        The outermost wrapper.
    """
    return wrap(make(**options), wrappers)
