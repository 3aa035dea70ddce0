"""The registry of environments: find one by id, object or function, and describe it."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import importlib.util
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, NamedTuple, TypeAlias, TypeVar, get_args

import gymnasium

from ..trees.groups import Group
from . import minigrid
from .adapters.gymnasium import EnvironmentFailure, MissingExtra
from .adapters.jax_protocol import kept_to_protocol, time_limit
from .capabilities import NativeEngine
from .classic.acrobot import Acrobot
from .classic.cartpole import CartPole
from .classic.mountain_car import MountainCar, MountainCarContinuous
from .classic.pendulum import Pendulum
from .diagnostics import warn_of_environment
from .env import Env
from .equality import step_limit
from .lunar_lander import engine as lander
from .names import NAMES, known_names
from .origin import Origin, Wrapping
from .remake import copier, describe, wrap
from .spaces import Features, action_spec, require_spaces
from .spec import Backend, EnvSpec, HostFactory, no_copies, not_listed

Factory: TypeAlias = Callable[..., gymnasium.Env] | Callable[..., Env]
Made = TypeVar("Made")


class UnknownEnvironment(ValueError):
    """No environment has this id."""


class Entry(NamedTuple):
    """The arguments of `register` for a name; without ``env`` and ``host`` it is one of Gymnasium's ids."""

    env: Env | Factory | None = None
    host: HostFactory | None = None
    feature_names: Sequence[str] | None = None
    action_names: Sequence[str] | None = None
    groups: Sequence[Group] | None = None


_ENTRIES: dict[str, Entry] = {}
_EXTRAS = ("box2d",)
"""Of ours, by the name Gymnasium knows them by, too."""


def register(
    name: str,
    env: Env | Factory | None = None,
    *,
    host: HostFactory | None = None,
    feature_names: Sequence[str] | None = None,
    action_names: Sequence[str] | None = None,
    groups: Sequence[Group] | None = None,
) -> None:
    """Give an environment a name, or give names to the features and actions of one.

    A later registration replaces an earlier one. Functions are called with the user's ``env_kwargs``.

    Args:
        name: The id.
        env: An environment written in JAX, or a function that makes one or a Gymnasium environment. Leave it out to
            name the features and actions of an id of Gymnasium's.
        host: A function that makes the counterpart in Gymnasium of an environment in JAX; policies are trained on the
            one and evaluated on the other. By default it is Gymnasium's own environment of this id, if there is one.
        feature_names: Names of the features.
        action_names: Names of the actions, or of the components of an action.
        groups: Features that are one-hot together.
    """
    _ENTRIES[name] = Entry(env, host, feature_names, action_names, groups)


register("CartPole-v1", CartPole())
register("Acrobot-v1", Acrobot())
register("Pendulum-v1", Pendulum())
register("MountainCar-v0", MountainCar())
register("MountainCarContinuous-v0", MountainCarContinuous())


def _minigrid(make: Callable[..., Made], env_id: str, **kwargs: Any) -> Made:
    """Make one of MiniGrid's in either form: both need Farama's package, which is what evaluates."""
    if importlib.util.find_spec("minigrid") is None:
        raise MissingExtra(
            f"{env_id} needs a package that is not installed; install it: pip install 'sympol[minigrid]'"
        )
    if env_id not in minigrid.TASKS:
        _require_known(env_id)
    return make(env_id, **kwargs)


for _id in minigrid.TASKS:
    register(_id, partial(_minigrid, minigrid.make, _id), host=partial(_minigrid, minigrid.make_host, _id))


_BUILT_IN = dict(_ENTRIES)
_OWN_ENTRY_POINTS = ("gymnasium.envs.", "minigrid.", "sympol.")


def _was_replaced(env_id: str) -> bool:
    """Whether an id of Gymnasium's or ours now means another environment: it was registered anew, or altered."""
    if env_id in _BUILT_IN and _ENTRIES.get(env_id, Entry()).env not in (None, _BUILT_IN[env_id].env):
        return True
    spec = gymnasium.registry.get(env_id)
    if spec is None or not (env_id in _BUILT_IN or env_id in NAMES or env_id in lander.IDS):
        return False
    limit = getattr(_BUILT_IN[env_id].env, "max_episode_steps", None) if env_id in _BUILT_IN else None
    return (
        not isinstance(spec.entry_point, str)
        or not spec.entry_point.startswith(_OWN_ENTRY_POINTS)
        or bool(spec.additional_wrappers)
        or (limit is not None and (spec.max_episode_steps != limit or bool(spec.kwargs)))
    )


def _entry(env_id: str) -> Entry:
    """What is known of an id: what was registered; of the rest of MiniGrid's, how to make it on the host."""
    known = _ENTRIES.get(env_id)
    if known is not None and known == _BUILT_IN.get(env_id) and _was_replaced(env_id):
        return Entry()  # what Gymnasium makes of it is not what our form of it does
    if env_id not in _ENTRIES and env_id.startswith(minigrid.FAMILIES):
        return Entry(host=partial(_minigrid, minigrid.make_host, env_id))
    return _ENTRIES.get(env_id, Entry())


def resolve(
    env: str | gymnasium.Env | Env | Factory,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    feature_names: Sequence[str] | None = None,
    action_names: Sequence[str] | None = None,
    groups: Sequence[Group] | None = None,
    backend: Backend = "auto",
    wrappers: Sequence[Wrapping] = (),
    require_installed: bool = True,
) -> EnvSpec:
    """Find an environment by id, object or factory, and describe it.

    Args:
        env: An id, an environment, or a function that makes one. An object is played itself.
        env_kwargs: Arguments to make the environment with, as those of `gymnasium.make`.
        feature_names: Names of the features; by default the registered ones, the environment's own, or ``x[0]``.
        action_names: Names of the actions; by default the registered ones, the environment's own, or ``action 0``.
        groups: Features that are one-hot together; by default the registered ones or the environment's own.
        backend: The form to train on: ``"jax"``, ``"native"`` (machine code) or ``"host"`` (Gymnasium). ``"auto"`` is
            the first of these that exists, machine code only where Numba is installed.
        wrappers: Wrappers of Gymnasium to put around an environment named by its id, from the innermost.
        require_installed: Whether backend ``"native"`` is refused where Numba is missing; otherwise only training
            fails.

    Returns:
        The description of the environment.

    Raises:
        UnknownEnvironment: No environment has this id; the message offers near ones.
        MissingExtra: The environment needs a package that is not installed.
        ValueError: A space is unsupported, names or groups do not fit, the environment does not take the arguments,
            or it lacks the backend.
        TypeError: The object is no environment.
    """
    if backend not in get_args(Backend):
        raise ValueError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}")
    kwargs = dict(env_kwargs or {})
    entry = _entry(env) if isinstance(env, str) else Entry()
    source: Any = partial(_make, env) if isinstance(env, str) else env
    if entry.env is not None and not (kwargs and not _is_factory(entry.env)):
        source = entry.env  # else it takes no kwargs, and Gymnasium's may
    elif entry.host is not None:
        source = entry.host
    if wrappers:
        inner = resolve(env, env_kwargs=kwargs, backend="host").make_host
        assert inner is not None
        source, entry = partial(_make_wrapped, inner, tuple(wrappers)), Entry()
    example, make_host, has_one_copy, find_origin, find_copies = _open(source, {} if wrappers else kwargs)
    name = env if isinstance(env, str) else _name(example)
    if isinstance(env, str) or (name in _ENTRIES and _ENTRIES[name].env is env):  # its name makes it again
        find_origin = partial(Origin.of_arguments, kwargs, tuple(wrappers))
    if _was_replaced(name):
        find_origin = partial(Origin, kwargs, tuple(wrappers), f"where {name} had been registered anew")
    jax_env = None if isinstance(example, gymnasium.Env) else example
    if jax_env is not None and entry.host is not None:
        make_host = partial(entry.host, **kwargs)
    elif jax_env is not None and name in gymnasium.registry:
        make_host = partial(_make, name, **kwargs)
    if backend == "jax" and jax_env is None:
        raise ValueError(f"{name} is not written in JAX; use backend='host' or 'auto'")
    if backend == "host" and make_host is None:
        raise ValueError(
            f"{name} is written in JAX and has no form in Gymnasium; use backend='jax' or 'auto'"
        )
    in_jax = jax_env is not None and backend in ("auto", "jax")
    as_it_is = isinstance(env, str) and not (
        entry.env or entry.host or kwargs or wrappers or _was_replaced(name)
    )
    native = None if in_jax else _native(name, as_it_is, insist=backend == "native")
    speed_hint = ""
    if native is not None and not native.is_installed():
        if backend == "native" and require_installed:
            native.require_installed()
        speed_hint = "" if backend == "native" else native.install_hint
        native = native if backend == "native" else None

    known = known_names(example, name)

    def own(what: str, given: Any) -> Any:
        offers = (given, getattr(entry, what), getattr(example, what, None), known.get(what))
        return next((offer for offer in offers if offer is not None), None)

    spec = EnvSpec(
        name=name,
        env=kept_to_protocol(jax_env) if jax_env is not None and in_jax else None,
        make_host=make_host,
        observation_space=example.observation_space,
        action_space=example.action_space,
        features=Features.of(
            example.observation_space,
            own("feature_names", feature_names),
            own("groups", groups),
            known.get("integers", ()),
        ),
        actions=action_spec(example.action_space, own("action_names", action_names)),
        max_episode_steps=_max_episode_steps(example),
        has_one_copy=has_one_copy,
        native=None if backend == "host" else native,
        speed_hint=speed_hint,
        all_observations=getattr(jax_env, "all_observations", not_listed),
        find_origin=find_origin,
        find_copies=find_copies,
    )
    warn_of_environment(example, name, len(spec.features.names))
    return spec


def _native(name: str, as_it_is: bool, *, insist: bool) -> NativeEngine | None:
    """The machine code of an environment that is exactly what Gymnasium makes of its id; None where there is none."""
    engine = lander.ENGINE if name in lander.IDS and as_it_is else None
    if insist and engine is None:
        raise ValueError(
            f"{name} cannot be stepped by our own machine code, which has {' and '.join(lander.IDS)}, by id and "
            "without env_kwargs; use backend='host' or 'auto'"
        )
    return engine


class _Source(NamedTuple):
    """One environment to look at, and how to make more of it in Gymnasium."""

    example: gymnasium.Env | Env
    make_host: HostFactory | None
    has_one_copy: bool = False
    find_origin: Callable[[], Origin] = Origin
    find_copies: Callable[[], HostFactory | None] = no_copies


def _open(env: Any, kwargs: dict[str, Any]) -> _Source:
    is_factory = _is_factory(env)
    if kwargs and not is_factory:
        raise ValueError(
            f"env_kwargs are for an environment that is made by id or by a function, got {kwargs}"
        )
    try:
        example = env(**kwargs) if is_factory else env
    except TypeError as error:
        if not kwargs:
            raise
        raise ValueError(f"env_kwargs {kwargs} do not fit this environment: {error}") from error
    if isinstance(example, gymnasium.Env) or (hasattr(example, "reset") and hasattr(example, "step")):
        require_spaces(example)
    if isinstance(example, gymnasium.Env):
        if not is_factory:
            # both may have to make another one: only where somebody asks
            return _Source(
                example,
                lambda: example,
                has_one_copy=True,
                find_origin=cache(
                    partial(describe, example, _remake, f"an object of class {_class(example)}")
                ),
                find_copies=cache(partial(copier, example)),
            )
        example.close()
        make = partial(env, **kwargs) if kwargs else env
        return _Source(example, make, find_origin=cache(partial(_describe_made, make, _label(env))))
    if isinstance(example, Env) and not isinstance(example, gymnasium.vector.VectorEnv):
        space = example.observation_space
        if not isinstance(space, gymnasium.spaces.Box) or len(space.shape) != 1:
            raise ValueError(f"an environment in JAX must observe a Box of shape (features,), got {space}")
        not_kept = f"an environment in JAX of class {_class(example)}"
        return _Source(example, None, find_origin=partial(Origin, kwargs, not_kept=not_kept))
    raise TypeError(
        "env must be an id, a gymnasium.Env, an environment in JAX (see sympol.envs.env), or a function that "
        f"makes one, got {env!r}" + (f", which made {example!r}" if is_factory else "")
    )


def _remake(env_id: str, kwargs: Mapping[str, Any]) -> gymnasium.Env:
    """Make an environment by its id and arguments, as loading a run does."""
    make_host = resolve(env_id, env_kwargs=kwargs, backend="host").make_host
    assert make_host is not None
    return make_host()


def _describe_made(make: HostFactory, label: str) -> Origin:
    made = make()
    try:
        return describe(made, _remake, f"made by the function {label}")
    finally:
        made.close()


def _make_wrapped(make: HostFactory, wrappers: Sequence[Wrapping], **options: Any) -> gymnasium.Env:
    return wrap(make(**options), wrappers)


def _class(env: object) -> str:
    kind = type(env.unwrapped if isinstance(env, gymnasium.Env) else env)
    return f"{kind.__module__}.{kind.__qualname__}"


def _label(function: Any) -> str:
    return getattr(function, "__qualname__", None) or repr(function)


def _is_factory(env: object) -> bool:
    # a class of environments has an environment's attributes too, but is a function that makes one
    return callable(env) and (isinstance(env, type) or not isinstance(env, gymnasium.Env | Env))


def _make(env_id: str, **kwargs: Any) -> gymnasium.Env:
    """Make one of Gymnasium's by its id, or by ``module:id`` where importing a module registers it."""
    name = _require_known(env_id)
    # the checker would repeat its warnings for every copy; what cannot be trained on, HostEnvs refuses
    try:
        with warnings.catch_warnings():
            # Box2D's SWIG warns at its import, and crashes the process where warnings are errors
            warnings.filterwarnings("ignore", r"builtin type \w+ has no __module__", DeprecationWarning)
            return gymnasium.make(name, disable_env_checker=True, **kwargs)
    except (TypeError, MissingExtra):
        raise
    except gymnasium.error.DependencyNotInstalled as error:
        hint = next(
            (f"install it: pip install 'sympol[{extra}]'" for extra in _EXTRAS if extra in str(error)), ""
        )
        raise MissingExtra(f"{env_id} needs a package that is not installed; {hint} ({error})") from error
    except gymnasium.error.Error:
        raise
    except Exception as error:
        raise EnvironmentFailure(f"{env_id} cannot be made{_with(kwargs)}: {_in_words(error)}") from error


def _require_known(env_id: str) -> str:
    """Return the id without its module, once that is imported.

    Raises:
        UnknownEnvironment: No environment has this id, or there is no such module; with near ids.
        ImportError: The module is there, but importing it failed.
    """
    module, _, name = env_id.rpartition(":")
    if name.lower().startswith(tuple(family.lower()[:-1] for family in minigrid.FAMILIES)):
        with contextlib.suppress(ImportError):  # registers the ids that are near
            importlib.import_module("minigrid")
    try:
        if module:
            _import(module)
        gymnasium.spec(name)
    except gymnasium.error.Error as error:
        known = {known.lower(): known for known in (*_ENTRIES, *gymnasium.registry)}
        near = [repr(known[match]) for match in difflib.get_close_matches(name.lower(), known)]
        hint = f"did you mean {' or '.join(near)}?" if near else "nothing known has a similar name."
        raise UnknownEnvironment(
            f"unknown environment {env_id!r}: {hint} An id of another package needs its module before "
            f"it, as in 'module:Name-v0'. ({error})"
        ) from error
    return name


def _import(module: str) -> None:
    """Import the module that a user named, for the environments that it registers."""
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module == missing or module.startswith(f"{missing}."):
            raise UnknownEnvironment(
                f"unknown environment: there is no module {missing}; is its folder on PYTHONPATH? ({error})"
            ) from error
        raise MissingExtra(
            f"module {module} was found, but needs {missing}, which is not installed; install it"
        ) from error
    except (Exception, SystemExit) as error:
        raise ImportError(
            f"module {module} was found, but importing it failed: {_in_words(error)}"
        ) from error


def _in_words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def _with(kwargs: Mapping[str, Any]) -> str:
    return f" with {', '.join(f'{name}={value!r}' for name, value in kwargs.items())}" if kwargs else ""


def _name(env: gymnasium.Env | Env) -> str:
    if not isinstance(env, gymnasium.Env):
        return type(env).__name__
    return env.spec.id if env.spec is not None else type(env.unwrapped).__name__


def _max_episode_steps(env: gymnasium.Env | Env) -> int | None:
    if isinstance(env, gymnasium.Env):
        limit = step_limit(env)
        return limit if limit is not None or env.spec is None else env.spec.max_episode_steps
    return time_limit(env)
